"""``make mutation``: change the safety code a little, a hundred ways, and see that a test notices.

Only the fast tests of each module's own judge it. Prints the share that was killed of each file,
and writes what survived, as differences, into a file. What may survive, and why, is said in
docs/testing.md.
"""

import argparse
import ast
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODULES = {
    "guard": "safety",
    "supervisor": "safety",
    "actuator_monitor": "safety",
    "sensor_monitor": "safety",
    "attitude_monitor": "safety",
    "joint_monitor": "safety",
    "frozen_values": "safety",
    "remote_watchdog": "safety",
    "stop_sequence": "safety",
    "a1_interface": "interface",
    "a1_remote": "protocol",
}
"""Of onboard/rmll_onboard, and the room of each; tests/onboard has a test of that name"""
TESTED_WITH = dict.fromkeys(
    ("attitude_monitor", "joint_monitor", "frozen_values"), "sensor_monitor"
)
"""Parts of another module, which is what is tested"""
PACKAGES = (
    "common/rmll_common",
    "gait_specs/rmll_gaits",
    "robots/rmll_robots",
    "contract/rmll_contract",
    "hil/rmll_hil",
)
KILLED = ("killed", "timeout", "caught by type check")
LEAST = 0.9
"""Share that has to be killed, of each file"""


def prepare(folder: Path, module: str) -> None:
    """A copy of what is needed, laid out as mutmut wants it: packages in src, tests in tests."""
    shutil.rmtree(folder, ignore_errors=True)
    ignored = shutil.ignore_patterns("__pycache__")
    for package in (*PACKAGES, "onboard/rmll_onboard"):
        path = ROOT / package
        shutil.copytree(path, folder / "src" / path.name, ignore=ignored)
    (folder / "tests").mkdir()
    for name in ("conftest.py", f"test_{TESTED_WITH.get(module, module)}.py"):
        shutil.copy(ROOT / "tests" / "onboard" / name, folder / "tests")
    mutated = f"src/rmll_onboard/{MODULES[module]}/{module}.py"
    undecorate(folder / mutated)
    (folder / "pyproject.toml").write_text(
        f"""[tool.mutmut]
source_paths = ["src"]
only_mutate = ["{mutated}"]
pytest_add_cli_args = ["-p", "no:cacheprovider", "-m", "not fuzz"]
pytest_add_cli_args_test_selection = ["tests"]
use_git_change_detection = false
[tool.pytest.ini_options]
addopts = "--import-mode=importlib"
markers = ["fuzz: what comes from outside"]
"""
    )


def undecorate(path: Path) -> None:
    """``@property`` before a function becomes ``name = property(name)`` after it, for mutmut leaves
    out what is decorated; caches go, for they remember what the code said before it was changed."""
    source = path.read_text()
    lines = source.splitlines(keepends=True)
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    for node in sorted(functions, key=lambda node: node.lineno, reverse=True):
        for decorator in node.decorator_list:
            if ast.unparse(decorator) == "property":
                text = f"{' ' * node.col_offset}{node.name} = property({node.name})\n"
                lines.insert(node.end_lineno or 0, text)
            del lines[decorator.lineno - 1]
    path.write_text("".join(lines))


def mutmut(folder: Path, *words: str) -> str:
    command = [sys.executable, "-c", "from mutmut.__main__ import cli; cli()", *words]
    return subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout


def judge(folder: Path, module: str) -> tuple[Counter[str], list[str]]:
    """How many mutants of the module had which outcome, and those that survived, as differences."""
    prepare(folder, module)
    mutmut(folder, "run")
    outcomes: Counter[str] = Counter()
    survivors = []
    for line in mutmut(folder, "results", "--all", "true").splitlines():
        name, colon, outcome = line.strip().partition(": ")
        if colon:
            outcomes[outcome] += 1
            if outcome not in KILLED:
                survivors.append(f"# {name}: {outcome}\n{mutmut(folder, 'show', name)}")
    return outcomes, survivors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", default=list(MODULES), choices=[[], *MODULES])
    parser.add_argument("--out", type=Path, default=Path("mutation"), help="scratch folder")
    chosen = parser.parse_args()
    folder = chosen.out.resolve()
    low, survivors = [], []
    for module in chosen.modules:
        counts, survived = judge(folder / module, module)
        survivors += survived
        killed, total = sum(counts[outcome] for outcome in KILLED), counts.total()
        print(f"{module:16} {killed} of {total} killed, {killed / max(total, 1):.1%}", flush=True)
        if killed < LEAST * total or not total:
            low.append(module)
    (folder / "survivors.txt").write_text("\n".join(survivors))
    print(f"survivors: {folder / 'survivors.txt'}")
    if low:
        sys.exit(f"less than {LEAST:.0%} killed: {', '.join(low)}")


if __name__ == "__main__":
    main()
