"""Opening a bundle, the one file a robot needs to run a gait, and refusing what is not one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from rmll_common.errors import InputError
from rmll_contract import contract as contracts
from rmll_contract import observation
from rmll_contract.contract import Contract
from rmll_contract.onnx_file import graph_sha256, metadata
from rmll_gaits.label import FEET
from rmll_gaits.table import MachineTable
from rmll_onboard.control.policy import ACTION, ESTIMATE, OBSERVATION, open_session
from rmll_robots import ROBOTS, Robot

MAX_BYTES = 64 * 1024 * 1024
"""A policy of three layers of 256 is under 1 MB"""


@dataclass(frozen=True)
class Bundle:
    """A checked bundle. Its trace is replayed by :func:`rmll_onboard.control.controller.prove`."""

    source: str
    contract: Contract
    table: MachineTable
    robot: Robot
    joints: NDArray[np.intp]
    """(12,), where each joint of the policy stands in the robot's order"""
    session: onnxruntime.InferenceSession


def load_bundle(path: Path) -> Bundle:
    """Read and check a bundle; raises InputError in one line for whatever is wrong with it."""
    source = path.name
    model = _read(path)
    try:
        digest, texts = graph_sha256(model), metadata(model)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    if contracts.KEY not in texts:
        raise InputError(f"{source}: not a bundle: no {contracts.KEY!r} entry in its metadata")
    contract = contracts.decode(texts[contracts.KEY], source)
    if contract.graph_sha256 != digest:
        raise InputError(f"{source}: the network was edited, it is not the one that was exported")
    # only what was exported comes as far as onnxruntime's own parser
    try:
        session = open_session(model)
    except Exception as error:  # onnxruntime's exceptions share no narrower base
        raise InputError(f"{source}: onnxruntime refuses it: {error}") from error
    try:
        table = MachineTable.from_dict(contract.table)
        robot = _robot(contract)
        _check_layout(contract, table)
        _check_numbers(contract, robot)
        _check_graph(contract, session)
        _check_trace(contract)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    joints = np.array([robot.joint_names.index(name) for name in contract.joint_names])
    return Bundle(source, contract, table, robot, joints, session)


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            model = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    if len(model) > MAX_BYTES:
        raise InputError(f"{path.name}: larger than {MAX_BYTES >> 20} MB, not a bundle")
    return model


def _robot(contract: Contract) -> Robot:
    if contract.robot not in ROBOTS:
        raise InputError(f"unknown robot {contract.robot!r}; known: {', '.join(ROBOTS)}")
    robot = ROBOTS[contract.robot]
    if sorted(contract.joint_names) != sorted(robot.joint_names):
        strange = sorted(set(contract.joint_names) - set(robot.joint_names))
        missing = sorted(set(robot.joint_names) - set(contract.joint_names))
        raise InputError(
            f"its joints are not those of {robot.name}: unknown {strange}, missing {missing}"
        )
    return robot


def _check_layout(contract: Contract, table: MachineTable) -> None:
    known = {f.name: f.size for f in observation.layout("imu", table.num_states)}
    sizes = {f.name: f.size for f in contract.observation}
    if len(sizes) != len(contract.observation) or not sizes.items() <= known.items():
        raise InputError(f"its observation is {sizes}, this runtime provides {known}")
    heights = [f.size for f in contract.estimates if f.name == "foot_height"]
    if heights != [len(FEET)]:
        raise InputError("its estimates are not those of this runtime: one foot_height of 4")


def _check_numbers(contract: Contract, robot: Robot) -> None:
    pose = contract.default_pose
    if len(pose) != len(robot.joint_names) or not np.isfinite(pose).all():
        raise InputError(f"default_pose is not {len(robot.joint_names)} angles: {pose}")
    for name, value, top in (
        ("kp", contract.kp, 1000.0),
        ("kd", contract.kd, 100.0),
        ("action_scale", contract.action_scale, 10.0),
        ("action_clip", contract.action_clip, 1000.0),
        ("torque_limit", contract.torque_limit, robot.torque_limit),
    ):
        if not 0 < value <= top:
            raise InputError(f"{name} is {value}, expected more than 0 and at most {top}")
    control, policy = contract.control_hz, contract.policy_hz
    if not 0 < policy <= control <= 1000 or control % policy:
        raise InputError(
            f"policy_hz {policy} and control_hz {control}: expected a divisor and at most 1000"
        )


def _check_graph(contract: Contract, session: onnxruntime.InferenceSession) -> None:
    def describe(values: Sequence[onnxruntime.NodeArg]) -> dict[str, str]:
        return {value.name: f"{value.type} {value.shape}" for value in values}

    expected = {
        OBSERVATION: observation.size(contract.observation),
        ACTION: len(contract.joint_names),
        ESTIMATE: observation.size(contract.estimates),
    }
    wanted = {name: f"tensor(float) [1, {size}]" for name, size in expected.items()}
    found = describe(session.get_inputs()) | describe(session.get_outputs())
    if found != wanted:
        raise InputError(f"its network has {found}, its contract expects {wanted}")


def _check_trace(contract: Contract) -> None:
    feet, joints = len(FEET), len(contract.joint_names)
    widths = {
        "touching": feet,
        "clear": feet,
        "joint_position": joints,
        "joint_velocity": joints,
        "projected_gravity": 3,
        "angular_velocity": 3,
        "command": 3,
        "label": None,
        "state": None,
        "phi": None,
        "observation": observation.size(contract.observation),
        "estimate": observation.size(contract.estimates),
        "action": joints,
        "target": joints,
    }
    steps = len(contract.trace.label)
    for name, width in widths.items():
        rows = getattr(contract.trace, name)
        sizes = {None if width is None else len(row) for row in rows}
        if len(rows) != steps or sizes != {width}:
            raise InputError(f"its golden trace: {name} is not {steps} rows of {width or 1}")
