"""The base install: what a robot's computer gets from ``pip install .``, and that it is enough."""

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOT_SOURCE = (".git", ".venv", "build", "*.egg-info", "runs", "hil-runs", "__pycache__", ".*_cache")

# PYTHONPATH would let the environment see more than was installed
CLEAN = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """bin folder of a clean environment with the project installed without extras."""
    folder = tmp_path_factory.mktemp("base")
    # a copy: building leaves files beside the sources
    source = shutil.copytree(ROOT, folder / "source", ignore=shutil.ignore_patterns(*NOT_SOURCE))
    venv.create(folder / "venv", with_pip=True)
    bin_folder = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin")
    install = [bin_folder / "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", source]
    subprocess.run(install, check=True, env=CLEAN, stdout=subprocess.DEVNULL)
    return bin_folder


def call(base: Path, tmp_path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [str(base / words[0]), *words[1:]]
    return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=CLEAN)


def test_a_bundle_can_be_checked_with_the_base_install(base: Path, tmp_path: Path) -> None:
    policy = str(ROOT / "policies" / "trot.onnx")
    done = call(base, tmp_path, "rmll-onboard", "--check", "--policy", policy)
    assert done.returncode == 0, done.stderr
    assert "trot" in done.stdout


def test_no_bundle_comes_with_it_and_that_is_told(base: Path, tmp_path: Path) -> None:
    done = call(base, tmp_path, "rmll-onboard", "--check", "--policy", "trot")
    told = "--policy trot: no policies/trot.onnx; there is: none; or name a file, trot.onnx"
    assert (done.returncode, done.stderr) == (2, f"rmll-onboard: {told}\n")


@pytest.mark.parametrize("command", ["gait", "train", "export", "onboard", "hil", "eval"])
def test_every_command_tells_its_version(base: Path, tmp_path: Path, command: str) -> None:
    done = call(base, tmp_path, f"rmll-{command}", "--version")
    assert (done.returncode, done.stdout.split()[0]) == (0, f"rmll-{command}")


def test_the_base_install_is_small(base: Path, tmp_path: Path) -> None:
    done = call(base, tmp_path, "pip", "list", "--format=freeze")
    names = {line.partition("==")[0].lower() for line in done.stdout.split()}
    assert {"rmll", "numpy", "onnxruntime", "pyyaml", "msgspec", "tyro"} <= names
    assert not names & {"torch", "mujoco", "onnx", "matplotlib", "lark", "rich", "mcap"}


@pytest.mark.parametrize("command", ["gait", "train", "export", "hil", "eval"])
def test_commands_whose_extra_is_missing_name_it(base: Path, tmp_path: Path, command: str) -> None:
    done = call(base, tmp_path, f"rmll-{command}", "--help")
    extra = {"gait": "view", "eval": "hil"}.get(command, command)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert f"pip install 'rmll[{extra}]'" in done.stderr
