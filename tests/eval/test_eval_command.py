"""The command itself."""

import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from rmll_common.errors import Failure, InputError
from rmll_common.optional_import import needs
from rmll_eval.conditions import Conditions
from rmll_eval.gait_command import gait

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


def evaluate(*flags: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rmll_eval.cli", "gait", *map(str, flags)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240)


def test_a_grid_prints_one_object_and_leaves_a_new_picture(tmp_path: Path) -> None:
    flags = ("--speeds", -0.5, 0.5, "--frequencies", 8, "--seconds", 2, "--jobs", 1, "--json")
    done = evaluate(TROT, *flags, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["gait"], found["world"], found["episodes"]) == ("trot", "emulator", 2)
    assert [(walk["vx"], walk["frequency"]) for walk in found["walks"]] == [(-0.5, 8), (0.5, 8)]
    assert found["falls"] == 0 and found["adherence"]["worst"] > 0.8
    (picture,) = tmp_path.glob("hil-runs/trot-grid-*/grid.png")
    assert picture.stat().st_size > 10_000
    assert str(picture.relative_to(tmp_path)) in done.stderr


def test_a_ground_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path) -> None:
    done = evaluate(TROT, "--ground", "lava", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    complaint = " ".join(done.stderr.replace("│", "").split())
    assert "invalid choice 'lava' for argument '--ground'" in complaint
    assert "'rough', 'uphill', 'downhill', 'stones'" in complaint


def test_episodes_print_a_table_and_leave_nothing(tmp_path: Path) -> None:
    done = evaluate(TROT, "--episodes", 1, "--seconds", 2, "--jobs", 1, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "trot in the emulator: 1 walk of 2 s, 0 with a fall" in done.stdout
    assert "wz error [rad/s]" in done.stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        ({"speeds": (7.0,)}, "--speeds 7: this gait was trained for -1 to 1"),
        ({"seconds": 1}, "--seconds 1: expected 2 to 1000000"),
        ({"jobs": 0}, "--jobs 0: expected 1 to 1024"),
        ({"conditions": Conditions("rough", 10)}, "--level 10: expected 0 to 9"),
        ({"out": Path("no/grid.png")}, "--out no/grid.png: expected a .png file in a folder"),
        ({"episodes": 2, "speeds": (1.0,)}, "--episodes draws commands: it has no grid to shape"),
    ],
)
def test_wrong_input_is_refused_before_anything_walks(flags: dict, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        gait(str(TROT), **flags)


def test_a_library_that_is_not_there_is_one_line() -> None:
    complaint = r"--world trainer: nothing_of_the_kind is not installed; .*'rmll\[train\]'"
    with pytest.raises(Failure, match=complaint), needs("--world trainer", "train"):
        import_module("nothing_of_the_kind")
