"""Which file a name means."""

import os
import shutil
from pathlib import Path

import pytest

from rmll_common.errors import InputError
from rmll_eval.evaluated_policy import find
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import prove

POLICIES = Path(__file__).parents[2] / "policies"


def test_a_gait_is_its_shipped_bundle(tmp_path: Path) -> None:
    shipped = POLICIES / "trot.onnx"
    found = find("trot", False, tmp_path, POLICIES, tmp_path)
    assert (found.bundle, found.source) == (shipped, shipped)


def test_a_gait_file_is_the_shipped_bundle_only_by_its_rules(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    commands = "commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}"
    mine.write_text(f"gait: trot\n{commands}\ncycle: [FL BR, FR BL]\n")
    assert find(str(mine), False, tmp_path, POLICIES, tmp_path).bundle == POLICIES / "trot.onnx"
    mine.write_text(f"gait: trot\n{commands}\ncycle: [FL BL, FR BR]\n")
    with pytest.raises(InputError, match=r"trot\.onnx has other rules than .*mine\.yaml; --run"):
        find(str(mine), False, tmp_path, POLICIES, tmp_path)


def test_the_newest_finished_run_is_exported(tmp_path: Path) -> None:
    for age, name in enumerate(("unfinished", "newest", "older")):
        run = tmp_path / "runs" / "trot" / name
        run.mkdir(parents=True)
        shutil.copy(POLICIES / "trot.safetensors", run / "policy.safetensors")
        if name != "unfinished":
            (run / "result.yaml").touch()
            os.utime(run / "result.yaml", (1000 - age, 1000 - age))
    found = find("trot", True, tmp_path / "runs", POLICIES, tmp_path)
    assert found.source.parent.name == "newest"
    assert found.told.startswith(f"taken: {found.source}, the newest finished run of trot\n")
    assert "passed over" in found.told and "unfinished" in found.told
    prove(load_bundle(found.bundle))


def test_a_checkpoint_is_exported(tmp_path: Path) -> None:
    found = find(str(POLICIES / "trot.safetensors"), False, tmp_path, tmp_path, tmp_path)
    assert (found.bundle.parent, found.source.name) == (tmp_path, "trot.safetensors")
    assert load_bundle(found.bundle).contract.gait == "trot"


@pytest.mark.parametrize(
    ("name", "run", "complaint"),
    [
        ("gallop", False, r"no .*gallop\.onnx; there is: .*trot.*--run"),
        ("gallop", True, r"no policy of gallop: no run in .*; there are: none"),
        ("trot.onnx", True, r"--run takes the name of a gait, found the file trot\.onnx"),
    ],
)
def test_what_is_not_there(name: str, run: bool, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=complaint):
        find(name, run, tmp_path, POLICIES, tmp_path)
