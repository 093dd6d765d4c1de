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
    "guard": "test_guard.py",
    "supervisor": "test_supervisor.py",
    "intake": "test_intake.py",
    "obedience": "test_obedience.py",
    "sensor_monitor": "test_sensor_monitor.py",
    "presence": "test_presence.py",
    "remote": "test_remote.py",
    "stop_sequence": "test_stop_sequence.py",
}
"""Of onboard/rmll_onboard, and the test of each in tests/onboard"""
PACKAGES = ("gait_specs/rmll_gaits", "robots/rmll_robots", "contract/rmll_contract")
KILLED = ("killed", "timeout", "caught by type check")
LEAST = 0.9
"""Share that has to be killed, of each file"""


def prepare(folder: Path, modules: list[str]) -> None:
    """A copy of what is needed, laid out as mutmut wants it: packages in src, tests in tests."""
    shutil.rmtree(folder, ignore_errors=True)
    ignored = shutil.ignore_patterns("__pycache__")
    for package in (*PACKAGES, "onboard/rmll_onboard"):
        path = ROOT / package
        shutil.copytree(path, folder / "src" / path.name, ignore=ignored)
    (folder / "tests").mkdir()
    for name in ("conftest.py", *(MODULES[module] for module in modules)):
        shutil.copy(ROOT / "tests" / "onboard" / name, folder / "tests")
    for module in modules:
        undecorate(folder / "src" / "rmll_onboard" / f"{module}.py")
    only = [f"src/rmll_onboard/{module}.py" for module in modules]
    (folder / "pyproject.toml").write_text(
        f"""[tool.mutmut]
source_paths = ["src"]
only_mutate = {only}
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
    out what is decorated."""
    source = path.read_text()
    lines = source.splitlines(keepends=True)
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    for node in sorted(functions, key=lambda node: node.lineno, reverse=True):
        if node.decorator_list:
            (decorator,) = node.decorator_list
            call = f"{ast.unparse(decorator)}({node.name})"
            lines.insert(node.end_lineno or 0, f"{' ' * node.col_offset}{node.name} = {call}\n")
            del lines[decorator.lineno - 1]
    path.write_text("".join(lines))


def mutmut(folder: Path, *words: str) -> str:
    command = [sys.executable, "-c", "from mutmut.__main__ import cli; cli()", *words]
    return subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", default=list(MODULES), choices=[[], *MODULES])
    parser.add_argument("--out", type=Path, default=Path("mutation"), help="scratch folder")
    chosen = parser.parse_args()
    folder = chosen.out.resolve()
    prepare(folder, chosen.modules)
    mutmut(folder, "run")
    outcomes: dict[str, Counter[str]] = {module: Counter() for module in chosen.modules}
    survivors = []
    for line in mutmut(folder, "results", "--all", "true").splitlines():
        name, colon, outcome = line.strip().partition(": ")
        module = name.split(".")[1] if colon else ""
        if module in outcomes:
            outcomes[module][outcome] += 1
            if outcome not in KILLED:
                survivors.append(f"# {name}: {outcome}\n{mutmut(folder, 'show', name)}")
    (folder / "survivors.txt").write_text("\n".join(survivors))
    low = []
    for module, counts in outcomes.items():
        killed, total = sum(counts[outcome] for outcome in KILLED), counts.total()
        print(f"{module:16} {killed} of {total} killed, {killed / max(total, 1):.1%}")
        if killed < LEAST * total or not total:
            low.append(module)
    print(f"survivors: {folder / 'survivors.txt'}")
    if low:
        sys.exit(f"less than {LEAST:.0%} killed: {', '.join(low)}")


if __name__ == "__main__":
    main()
