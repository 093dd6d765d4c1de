"""What documents point to is there: files, headings, tests."""

import ast
import re
from pathlib import Path

import msgspec
import pytest

from rmll_hil.faults.fault_rows import ROWS
from rmll_onboard.settings.runtime_settings import Safety

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    *sorted(ROOT.glob("*.md")),
    *sorted(path for folder in ROOT.glob("[a-z]*") for path in folder.rglob("*.md")),
]
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
TEST = re.compile(r"(tests/[\w/]+\.py)(?:::(\w+))?")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document: Path) -> None:
    for link in LINK.findall(document.read_text()):
        if link.startswith(("https://", "http://")):
            continue
        name, _, anchor = link.partition("#")
        target = (document.parent / name).resolve() if name else document
        assert target.exists(), link
        assert target.is_relative_to(ROOT), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_tests_that_are_named_exist(document: Path) -> None:
    for file, name in TEST.findall(document.read_text()):
        tree = ast.parse((ROOT / file).read_text())
        tests = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not name or name in tests, f"{file}::{name}"


def anchors(document: Path) -> set[str]:
    """Of a document's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", document.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


SAFETY = (ROOT / "docs" / "safety.md").read_text()


def test_the_safety_page_has_every_limit_with_its_default() -> None:
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \| (-?[\d.]+) ", SAFETY, re.MULTILINE)
    told = {name: float(limit) for names, limit in rows for name in re.findall(r"\w+", names)}
    assert told == msgspec.structs.asdict(Safety())


def test_the_safety_page_names_rows_of_the_fault_table() -> None:
    named = set(re.findall(r"\[(\w+)\](?!\()", SAFETY)) - {"NAME"}
    assert named and named <= {row.name for row in ROWS}


def test_library_facts_are_of_the_versions_that_are_installed() -> None:
    page = (ROOT / "docs" / "library_facts.md").read_text()
    named = re.findall(r"^## (\S+==\S+)$", page, re.MULTILINE)
    assert named and set(named) <= set((ROOT / "constraints.txt").read_text().split())
