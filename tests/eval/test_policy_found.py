"""Which file a name means."""

import os
import shutil
from pathlib import Path

import pytest

from rmll_eval.policy import find
from rmll_gaits.errors import InputError
from rmll_onboard.bundle import load_bundle
from rmll_onboard.controller import prove

POLICIES = Path(__file__).parents[2] / "policies"


def test_a_gait_is_its_shipped_bundle(tmp_path: Path) -> None:
    shipped = POLICIES / "trot.onnx"
    assert find("trot", False, tmp_path, POLICIES, tmp_path) == (shipped, shipped)


def test_the_newest_finished_run_is_exported(tmp_path: Path) -> None:
    for age, name in enumerate(("unfinished", "newest", "older")):
        run = tmp_path / "runs" / "trot" / name
        run.mkdir(parents=True)
        shutil.copy(POLICIES / "trot.safetensors", run / "policy.safetensors")
        if name != "unfinished":
            (run / "result.yaml").touch()
            os.utime(run / "result.yaml", (1000 - age, 1000 - age))
    bundle, source = find("trot", True, tmp_path / "runs", POLICIES, tmp_path)
    assert source.parent.name == "newest"
    prove(load_bundle(bundle))


def test_a_checkpoint_is_exported(tmp_path: Path) -> None:
    bundle, source = find(str(POLICIES / "trot.safetensors"), False, tmp_path, tmp_path, tmp_path)
    assert (bundle.parent, source.name) == (tmp_path, "trot.safetensors")
    assert load_bundle(bundle).contract.gait == "trot"


@pytest.mark.parametrize(
    ("name", "run", "complaint"),
    [
        ("gallop", False, r"no .*gallop\.onnx; there is: .*trot.*--run"),
        ("gallop", True, r"no finished run of 'gallop' in .*; there are runs of: none"),
        ("trot.onnx", True, r"--run takes the name of a gait, found the file trot\.onnx"),
    ],
)
def test_what_is_not_there(name: str, run: bool, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=complaint):
        find(name, run, tmp_path, POLICIES, tmp_path)
