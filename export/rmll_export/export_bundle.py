"""Checkpoint -> bundle: the graph, its contract, and the proof that it answers as the learner."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray

from rmll_common.errors import Failure, InputError
from rmll_contract import contract as contracts
from rmll_contract.contract import Contract
from rmll_contract.onnx_file import graph_sha256
from rmll_export.checkpoint_reader import Checkpoint
from rmll_export.graph import build
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import TRACE_TOLERANCE, prove


def export(checkpoint: Checkpoint, path: Path) -> float:
    """Write the bundle to ``path``; returns the largest difference from the learner's answers.

    Nothing is written, and Failure raised, if onnxruntime does not give the learner's answers, on
    its random probes and on the golden trace, to within what the daemon allows, or if the daemon
    would refuse the bundle.
    """
    model = build(checkpoint)
    difference = verify(model.SerializeToString(), checkpoint)
    if not difference < TRACE_TOLERANCE:
        raise Failure(
            f"{checkpoint.source}: onnxruntime differs from the learner by {difference:.2g}, "
            f"expected less than {TRACE_TOLERANCE:.0e}"
        )
    unsealed = msgspec.structs.replace(
        checkpoint.contract, graph_sha256=graph_sha256(model.SerializeToString())
    )
    contract = contracts.seal(unsealed)
    onnx.helper.set_model_props(
        model, {contracts.KEY: contracts.encode(contract)} | _mjlab_keys(contract)
    )
    # under its own name, so that what the daemon says of it names it
    with _scratch(path) as folder:
        written = Path(folder) / path.name
        written.write_bytes(model.SerializeToString())
        try:
            prove(load_bundle(written))
        except InputError as error:
            raise Failure(f"not written, the daemon would refuse it: {error}") from error
        written.replace(path)
    return difference


def _scratch(path: Path) -> TemporaryDirectory[str]:
    """A folder beside ``path``; an OSError names the latter, for nobody asked for the folder."""
    try:
        return TemporaryDirectory(prefix=".rmll-export-", dir=path.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def verify(model: bytes, checkpoint: Checkpoint) -> float:
    """Largest difference between onnxruntime and the learner, on the probes and the trace; NaN if
    one of them is."""
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    trace = checkpoint.contract.trace
    observations = np.vstack([checkpoint.probe_observation, trace.observation])
    actions = np.vstack([checkpoint.probe_action, trace.action])
    estimates = np.vstack([checkpoint.probe_estimate, trace.estimate])
    differences = []
    for observation, action, estimate in zip(observations, actions, estimates, strict=True):
        feed = {"observation": observation[None].astype(np.float32)}
        found = session.run(["action", "estimate"], feed)
        differences += [_difference(found[0], action), _difference(found[1], estimate)]
    return float(np.max(differences))


def _difference(found: Any, expected: NDArray) -> float:
    """The largest one, as a share of the largest expected number or of 1."""
    return float(np.abs(np.asarray(found) - expected).max() / max(1.0, np.abs(expected).max()))


def _mjlab_keys(contract: Contract) -> dict[str, str]:
    """The metadata that mjlab's tools look for, as comma-separated lists."""
    joints = len(contract.joint_names)

    def listed(values: object) -> str:
        return ",".join(str(value) for value in values)  # type: ignore[attr-defined]

    return {
        "joint_names": listed(contract.joint_names),
        "joint_stiffness": listed([contract.kp] * joints),
        "joint_damping": listed([contract.kd] * joints),
        "default_joint_pos": listed(contract.default_pose),
        "action_scale": listed([contract.action_scale] * joints),
        "observation_names": listed(field.name for field in contract.observation),
        "command_names": "vx,wz,frequency",
    }
