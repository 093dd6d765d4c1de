"""The house's own rules: which package may know which, and what the robot must never load."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "rmll_common": "common",
    "rmll_gaits": "gait_specs",
    "rmll_robots": "robots",
    "rmll_contract": "contract",
    "rmll_view": "view",
    "rmll_train": "train",
    "rmll_export": "export",
    "rmll_onboard": "onboard",
    "rmll_hil": "hil",
    "rmll_eval": "eval",
}
_BASE = {"rmll_common", "rmll_gaits", "rmll_robots", "rmll_contract"}
MAY_IMPORT = {
    "rmll_common": set(),
    "rmll_gaits": {"rmll_common"},
    "rmll_robots": set(),
    "rmll_contract": {"rmll_common", "rmll_gaits", "rmll_robots"},
    "rmll_view": {"rmll_common", "rmll_gaits", "rmll_contract"},
    "rmll_train": _BASE | {"rmll_view", "rmll_onboard"},
    "rmll_export": _BASE | {"rmll_onboard"},
    "rmll_onboard": _BASE,
    "rmll_hil": _BASE | {"rmll_view", "rmll_onboard"},
    "rmll_eval": set(PACKAGES),
}
ROOMS = {
    "rmll_onboard": (
        "state", "protocol", "settings", "control", "interface", "commands", "safety", "recording",
        "runtime",
    ),
    "rmll_hil": ("robot", "runs", "replay", "faults"),
    "rmll_train": ("env", "learning"),
}  # fmt: skip
"""Of each package, from the bottom up"""
APART = {
    "protocol": {"settings", "control"},
    "control": {"protocol"},
    "commands": {"settings", "control", "interface"},
    "recording": {"protocol", "interface", "commands", "safety"},
}
"""Rooms that need not know these, although they are below or beside them"""
ROBOT_END_MAY_USE = (
    "rmll_onboard.state.packet_errors.",
    "rmll_onboard.state.robot_state.RobotState",
    "rmll_onboard.state.robot_state.MotorCommand",
    "rmll_onboard.settings.can_settings.",
    "rmll_onboard.interface.transport.",
)
"""What hil's robot/ takes from the runtime that it judges: structs, settings and a socket, but no
codec and no number of one"""
HEAVY = {"torch", "mujoco", "onnx", "matplotlib", "rsl_rl", "tensorboard", "safetensors"}
MOST_MODULES = 16
"""In a folder"""


def sources(package: str) -> list[Path]:
    found = sorted((ROOT / PACKAGES[package] / package).rglob("*.py"))
    assert found, package
    return found


def imports(path: Path) -> set[str]:
    """Full names of all imported modules, those inside functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_run_downwards(package: str) -> None:
    for path in sources(package):
        ours = {name.split(".")[0] for name in imports(path) if name.startswith("rmll_")}
        assert ours - {package} <= MAY_IMPORT[package], path


@pytest.mark.parametrize("package", ROOMS)
def test_rooms_use_only_those_below_them(package: str) -> None:
    rooms = ROOMS[package]
    folders = {path.parent.name for path in sources(package) if path.parent.parent.name == package}
    assert folders - {"experiments"} == set(rooms)
    for height, room in enumerate(rooms):
        for path in (ROOT / PACKAGES[package] / package / room).glob("*.py"):
            ours = {name for name in imports(path) if name.startswith(f"{package}.")}
            used = {name.split(".")[1] for name in ours} & set(rooms)
            assert used <= {*rooms[: height + 1]} - APART.get(room, set()), path


def test_the_emulated_robot_has_a_codec_of_its_own() -> None:
    """If it read packets as the runtime writes them, a misread field would not be seen."""
    for path in (ROOT / "hil" / "rmll_hil" / "robot").glob("*.py"):
        taken = {name for name in imports(path) if name.startswith("rmll_onboard.")}
        assert {name for name in taken if not name.startswith(ROBOT_END_MAY_USE)} == set(), path


def test_a_file_or_class_name_stands_for_one_thing() -> None:
    files, classes = defaultdict(list), defaultdict(list)
    for path in (path for package in PACKAGES for path in sources(package)):
        if path.stem not in ("__init__", "cli"):
            files[path.stem].append(path)
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                classes[node.name.lstrip("_")].append(path)
    assert [paths for paths in files.values() if len(paths) > 1] == []
    assert {name: paths for name, paths in classes.items() if len(paths) > 1} == {}


def annotations(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[ast.expr]:
    """Of all parameters and of what is returned."""
    spots = node.args
    given = [*spots.posonlyargs, *spots.args, *spots.kwonlyargs, spots.vararg, spots.kwarg]
    found = [spot.annotation for spot in given if spot is not None]
    yield from (annotation for annotation in [*found, node.returns] if annotation is not None)


def loose(annotation: ast.expr) -> bool:
    """It holds, at any depth, a dictionary that says nothing of its values."""
    text = annotation.value if isinstance(annotation, ast.Constant) else ast.unparse(annotation)
    return re.search(r"\b[dD]ict(\[\w+, Any\]|(?![\w\[]))", str(text)) is not None


def loose_functions(tree: ast.Module) -> list[str]:
    """Public ones, methods among them, and those that call such a dictionary by another name."""
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    public = [n for n in functions if not n.name.startswith("_")]
    aliases = [n for n in tree.body if isinstance(n, ast.Assign) and loose(n.value)]
    aliases = [n for n in aliases if isinstance(n.value, ast.Subscript | ast.Name)]
    return [n.name for n in public if any(map(loose, annotations(n)))] + [
        ast.unparse(n.targets[0]) for n in aliases
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_public_signature_says_what_is_in_a_dictionary(package: str) -> None:
    found = {path: loose_functions(ast.parse(path.read_text())) for path in sources(package)}
    assert {path: names for path, names in found.items() if names} == {}


@pytest.mark.parametrize(
    ("code", "names"),
    [
        ("def f(a: dict[str, Any]): ...", ["f"]),
        ("class A:\n    def f(self, *, a: list[dict[str, Any]] | None = None): ...", ["f"]),
        ("async def f() -> 'dict[str, Any]': ...", ["f"]),
        ("def f(**a: dict): ...", ["f"]),
        ("Report = dict[str, Any]", ["Report"]),
        ("def _f(a: dict[str, Any]): ...", []),
        ("def f(a: dict[str, object], b: TensorDict) -> dict[str, float]: ...", []),
        ("def f(): return dict(a=1)", []),
    ],
)
def test_how_a_loose_dictionary_is_found(code: str, names: list[str]) -> None:
    assert loose_functions(ast.parse(code)) == names


def test_a_folder_can_be_overlooked() -> None:
    folders = {path.parent for package in PACKAGES for path in sources(package)}
    modules = {folder: len([*folder.glob("[!_]*.py")]) for folder in folders}
    assert {folder: n for folder, n in modules.items() if n > MOST_MODULES} == {}


@pytest.mark.parametrize(
    "package", ["rmll_common", "rmll_gaits", "rmll_robots", "rmll_contract", "rmll_onboard"]
)
def test_the_robots_side_never_loads_what_the_robot_lacks(package: str) -> None:
    modules = [
        ".".join(path.relative_to(ROOT / PACKAGES[package]).with_suffix("").parts)
        for path in sources(package)
        if path.name != "__init__.py"
    ]
    code = (
        f"import sys, importlib; [importlib.import_module(name) for name in {modules}]; "
        f"print(*sorted({HEAVY} & set(sys.modules)))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert loaded.returncode == 0, loaded.stderr
    assert loaded.stdout.split() == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_folder_says_what_comes_in_and_goes_out(package: str) -> None:
    assert (ROOT / PACKAGES[package] / "README.md").is_file()
