"""The house's own rules: which package may know which, and what the robot must never load."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
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
MAY_IMPORT = {
    "rmll_gaits": set(),
    "rmll_robots": set(),
    "rmll_contract": {"rmll_gaits", "rmll_robots"},
    "rmll_view": {"rmll_gaits", "rmll_contract"},
    "rmll_train": {"rmll_gaits", "rmll_robots", "rmll_contract", "rmll_view", "rmll_onboard"},
    "rmll_export": {"rmll_gaits", "rmll_robots", "rmll_contract", "rmll_onboard"},
    "rmll_onboard": {"rmll_gaits", "rmll_robots", "rmll_contract"},
    "rmll_hil": {"rmll_gaits", "rmll_robots", "rmll_contract", "rmll_view", "rmll_onboard"},
    "rmll_eval": set(PACKAGES),
}
HEAVY = {"torch", "mujoco", "onnx", "matplotlib", "rsl_rl", "tensorboard", "safetensors"}


def sources(package: str) -> list[Path]:
    found = sorted((ROOT / PACKAGES[package] / package).rglob("*.py"))
    assert found, package
    return found


def imports(path: Path) -> set[str]:
    """Top-level names of all imports, those inside functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_run_downwards(package: str) -> None:
    for path in sources(package):
        ours = {name for name in imports(path) if name.startswith("rmll_")} - {package}
        assert ours <= MAY_IMPORT[package], path


@pytest.mark.parametrize("package", ["rmll_gaits", "rmll_robots", "rmll_contract", "rmll_onboard"])
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
