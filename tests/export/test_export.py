"""From a checkpoint file to a bundle, and what is refused on the way."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from safetensors.numpy import load_file, save_file

from rmll_common.errors import Failure, InputError
from rmll_contract import contract as contracts
from rmll_export.card import MEASURED, card
from rmll_export.checkpoint_reader import read
from rmll_export.export_bundle import export
from rmll_gaits.load import library_names

SHIPPED = Path(__file__).parents[2] / "policies"


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    path = tmp_path / "policy.safetensors"
    path.write_bytes((SHIPPED / "trot.safetensors").read_bytes())
    return path


def rewrite(path: Path, change) -> None:
    """Save the file again with changed tensors and the same header."""
    tensors = load_file(path)
    header = {contracts.KEY: contracts.encode(read(path).contract)}
    change(tensors)
    save_file(tensors, path, metadata=header)


def test_every_gait_of_the_library_is_shipped() -> None:
    assert {path.stem for path in SHIPPED.glob("*.onnx")} == set(library_names())


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.onnx")), ids=lambda path: path.stem)
def test_each_shipped_bundle_is_the_export_of_its_checkpoint(path: Path, tmp_path: Path) -> None:
    bundle = tmp_path / path.name
    export(read(path.with_suffix(".safetensors")), bundle)
    assert bundle.read_bytes() == path.read_bytes()


def test_other_tools_find_the_keys_of_mjlab(checkpoint: Path, tmp_path: Path) -> None:
    bundle = tmp_path / "trot.onnx"
    export(read(checkpoint), bundle)
    model = onnx.load(bundle)
    keys = {prop.key: prop.value for prop in model.metadata_props}
    assert {"joint_names", "joint_stiffness", "joint_damping", "default_joint_pos", "action_scale",
            "observation_names", "command_names", "rmll"} == set(keys)  # fmt: skip
    assert len(keys["joint_stiffness"].split(",")) == 12
    contract = json.loads(keys["rmll"])
    # full precision, where mjlab's own keys are rounded by many tools
    assert [float(x) for x in keys["default_joint_pos"].split(",")] == contract["default_pose"]


def test_weights_that_do_not_answer_like_the_learner_are_not_exported(
    checkpoint: Path, tmp_path: Path
) -> None:
    def spoil(tensors) -> None:
        tensors["policy.0.weight"] = tensors["policy.0.weight"] + np.float32(1e-3)

    rewrite(checkpoint, spoil)
    with pytest.raises(Failure, match="differs from the learner"):
        export(read(checkpoint), tmp_path / "trot.onnx")
    assert not (tmp_path / "trot.onnx").exists()


def test_a_place_that_cannot_be_written_is_named(checkpoint: Path) -> None:
    place = Path("/proc/trot.onnx")
    with pytest.raises(OSError) as caught:
        export(read(checkpoint), place)
    assert caught.value.filename == str(place)


def test_a_folder_is_no_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder, expected a policy"):
        read(tmp_path)


def test_a_missing_tensor_is_named(checkpoint: Path) -> None:
    rewrite(checkpoint, lambda tensors: tensors.pop("policy.0.bias"))
    with pytest.raises(InputError, match=r"policy\.0\.bias"):
        read(checkpoint)


@pytest.mark.parametrize("content", [b"", b"hello", b"\xff" * 100])
def test_a_file_that_is_no_checkpoint_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "policy.safetensors"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a safetensors file"):
        read(path)


def test_a_truncated_checkpoint_is_refused(checkpoint: Path) -> None:
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    with pytest.raises(InputError, match="not a safetensors file"):
        read(checkpoint)


WITHOUT_TORCH = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Blocked())
from rmll_export.cli import main
main()
"""


def test_the_command_exports_without_torch(tmp_path: Path) -> None:
    flags = ["--gait", "trot", "--json", "--out", str(tmp_path / "trot.onnx"),
             "--policies", str(SHIPPED), "--runs", str(tmp_path / "runs")]  # fmt: skip
    call = [sys.executable, "-c", WITHOUT_TORCH, *flags]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["gait"] == "trot" and report["difference_from_learner"] < 1e-5


def test_the_card_tells_what_was_measured_and_by_which_command(tmp_path: Path) -> None:
    both = {"mean": 0.987, "worst": 0.9}
    evaluation = dict.fromkeys(MEASURED, both) | {
        "gait": "trot", "world": "emulator", "ground": "rough", "level": 5, "pushes": True,
        "episodes": 20, "seconds": 20.0, "falls": 1, "faults": 0,
        "energy_at_the_papers_speeds": None,
    }  # fmt: skip
    contract = read(SHIPPED / "trot.safetensors").contract
    contract.provenance["stages"] = [{"steps": 5000, "commit": "abc", "settings": {}}]
    text = card(contract, "trot.onnx", [evaluation])
    command = "rmll-eval gait trot --episodes 20 --seconds 20 --ground rough --level 5 --pushes"
    assert f"`{command}`" in text
    assert "| adherence | 0.987 | 0.9 |" in text
    assert "| falls | 1 of 20 | |" in text
    assert "useful" not in text  # of rough ground and pushes nobody says so
    calm = evaluation | {"ground": "flat", "pushes": False, "falls": 0}
    assert "| useful | vx error 0.987 m/s" in card(contract, "trot.onnx", [calm])
    both["mean"] = 0.1
    calm["adherence"] = {"mean": 0.99, "worst": 0.9}
    assert "| useful | yes | |" in card(contract, "trot.onnx", [calm])
    assert "| with other code or settings | up to step 5,000 at `abc` |" in text
