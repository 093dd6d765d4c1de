"""Text is printed as it is, by every command."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from rmll_view.console import bar, console

ROOT = Path(__file__).parents[2]
FOLDERS = ("gait_specs", "robots", "contract", "view", "train", "export", "onboard", "hil", "eval")


def markup(source: str) -> Iterator[str]:
    """Calls of rich in whose text a bracket would be markup."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func).rpartition(".")[2]
        plain = {word.arg for word in node.keywords if ast.unparse(word.value) == "False"}
        if name in ("from_markup", "status"):
            yield f"line {node.lineno}: {name}"
        if name in ("Console", "TextColumn") and "markup" not in plain:
            yield f"line {node.lineno}: {name} without markup=False"


def test_no_text_is_read_as_markup() -> None:
    sources = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    found = {str(path): list(markup(path.read_text())) for path in sources}
    assert len(found) > 100
    assert {path: calls for path, calls in found.items() if calls} == {}


def test_what_would_read_text_as_markup_is_found() -> None:
    source = "Console(stderr=True)\nTextColumn('{task}')\nscreen.status('x')\nConsole(markup=False)"
    assert len(list(markup(source))) == 3


def test_brackets_and_colons_stay(capsys: pytest.CaptureFixture[str]) -> None:
    text = "[red]vx[/red] [m/s] motor[3].q :warning: [/nothing]"
    console().print(text, "[s]")
    with bar() as progress:
        progress.add_task(text, total=1)
        console().print(progress.get_renderable())
    out, _ = capsys.readouterr()
    first, *rest = out.splitlines()
    assert first == f"{text} [s]"
    assert text in " ".join(" ".join(rest).split())
