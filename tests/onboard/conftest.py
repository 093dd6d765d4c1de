"""A small bundle with random weights, and a robot without physics."""

from pathlib import Path

import msgspec
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from rmll_contract import contract as contracts
from rmll_contract import observation
from rmll_contract.contract import Contract, Labels, Trace
from rmll_contract.onnx_file import graph_sha256
from rmll_gaits.table import ADVANCE, REJECT, Commands, MachineTable
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.control.controller import Controller, PolicyInput
from rmll_onboard.control.leg_force import LegForce
from rmll_onboard.control.policy import open_session
from rmll_onboard.settings.runtime_settings import (
    LinkSettings,
    Motion,
    RuntimeSettings,
    Safety,
    Steering,
)
from rmll_onboard.state.robot_state import MotorCommand, RobotState
from rmll_robots import A1

BOARD = A1BoardPackets()
TROT = 6, 9
"""Labels of the two diagonals"""
HEIGHT = 0.1
"""[m]"""
FORBIDDEN = 15
"""Here, standing on all feet leads from the second state to the sink"""


def trot_table() -> MachineTable:
    shape = 3, 16
    next_state = np.repeat(np.arange(3)[:, None], 16, axis=1)
    effect, hold = np.zeros(shape, int), np.zeros(shape, bool)
    for state, label in enumerate(TROT):
        next_state[state, label], effect[state, label] = 1 - state, ADVANCE
        hold[1 - state, label] = True
    next_state[1, FORBIDDEN], effect[1, FORBIDDEN] = 2, REJECT
    return MachineTable(
        gait="trot",
        states=("q0", "q1", "sink"),
        start=0,
        sink=2,
        commands=Commands(vx=(-1.0, 1.0), wz=(-1.0, 1.0), frequency=(6.0, 12.0)),
        next_state=next_state,
        effect=effect,
        dwell=np.ones(shape),
        grace=np.zeros(shape, int),
        hold=hold,
    )


def network(inputs: int, seed: int = 0) -> onnx.ModelProto:
    """action = tanh(obs A), estimate = obs B + c, with small random A and B; feet seem to be at
    about ``HEIGHT``, so that contact alone says which are down."""
    random = np.random.default_rng(seed)
    weights = {
        name: random.normal(0, 0.1, (inputs, size)).astype(np.float32)
        for name, size in (("a", 12), ("b", 7))
    }
    weights["b"][:, 3:] *= 0.01
    weights["c"] = np.array([0.0] * 3 + [HEIGHT] * 4, np.float32)
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", ["observation", "a"], ["hidden"]),
            helper.make_node("Tanh", ["hidden"], ["action"]),
            helper.make_node("MatMul", ["observation", "b"], ["seen"]),
            helper.make_node("Add", ["seen", "c"], ["estimate"]),
        ],
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, inputs])],
        [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size])
            for name, size in (("action", 12), ("estimate", 7))
        ],
        [numpy_helper.from_array(array, name) for name, array in weights.items()],
    )
    return helper.make_model(
        graph, ir_version=8, opset_imports=[helper.make_opsetid("", 17)], producer_name="test"
    )


EMPTY = Trace(*([] for _ in Trace.__struct_fields__))


def trot_contract() -> Contract:
    labels = Labels(contact_force=1.0, clearance=0.03)
    return contracts.describe(A1, trot_table(), "imu", labels, {"seed": 0}, EMPTY)


def record_trace(model: bytes, contract: Contract, steps: int = 40) -> Trace:
    """What a controller does on random joint data while the diagonals alternate."""
    robot_joints = [A1.joint_names.index(name) for name in contract.joint_names]
    bundle = Bundle(
        "trace",
        contract,
        MachineTable.from_dict(contract.table),
        A1,
        np.array(robot_joints),
        open_session(model),
    )
    controller = Controller(bundle)
    random = np.random.default_rng(1)
    rows = {name: [] for name in Trace.__struct_fields__}
    for step in range(steps):
        label = TROT[step // 8 % 2]
        touching = np.array([bool(label >> foot & 1) for foot in range(4)])
        inputs = {
            "touching": touching,
            "clear": ~touching,
            "joint_position": np.array(contract.default_pose) + random.normal(0, 0.1, 12),
            "joint_velocity": random.normal(0, 1, 12),
            "projected_gravity": np.array([0.0, 0.0, -1.0]),
            "angular_velocity": random.normal(0, 0.1, 3),
            "command": np.array([0.5, 0.0, 8.0]),
        }
        touching, clear, *sensed, command = inputs.values()
        controller.step(touching, clear, PolicyInput(*sensed), command)
        answers = {name: getattr(controller, name) for name in rows.keys() - inputs.keys()}
        for name, value in (inputs | answers).items():
            rows[name].append(np.array(value).tolist())
    return Trace(**rows)


def write_bundle(path: Path, model: onnx.ModelProto | None = None, **changes) -> Path:
    """A bundle as the exporter makes it; ``changes`` replace entries of its contract."""
    contract = msgspec.structs.replace(trot_contract(), **changes)
    if model is None:
        model = network(observation.size(contract.observation))
    if "trace" not in changes:
        trace = record_trace(model.SerializeToString(), contract)
        contract = msgspec.structs.replace(contract, trace=trace)
    digest = graph_sha256(model.SerializeToString())
    contract = contracts.seal(msgspec.structs.replace(contract, graph_sha256=digest))
    helper.set_model_props(model, {contracts.KEY: contracts.encode(contract)})
    path.write_bytes(model.SerializeToString())
    return path


class KinematicRobot:
    """Joints that follow their targets within a few ticks, on an A1 that floats upright; all its
    sensors agree.

    While it walks its feet touch the ground as a trot's would, eight policy steps a diagonal.
    """

    def __init__(self) -> None:
        self.state = RobotState(quaternion=np.array([1.0, 0, 0, 0]), q=A1.crouch_pose.copy())
        self.last: MotorCommand | None = None
        self.orientation = np.array([1.0, 0.0, 0.0, 0.0])

    def answer(self, datagram: bytes) -> bytes:
        command = BOARD.decode_command(datagram)
        self.last = command
        state, before = self.state, self.state.q.copy()
        if command.kp.any():
            state.q += 0.4 * (command.q - state.q)
        state.dq[:] = (state.q - before) / 0.005
        state.mode[:] = command.mode
        state.tick += 5
        # no sensor stands still
        state.accelerometer[:] = 0.01 * (state.tick % 7), 0.0, 9.81
        state.tau[:] = 0.01 * (state.tick % 3)
        state.gyro[:] = 0.001 * (state.tick % 11)
        state.quaternion[:] = self.orientation
        state.quaternion[1] += 1e-5 * (state.tick % 13)
        state.rpy[0] = 2e-5 * (state.tick % 13)
        label = TROT[self.state.tick // 160 % 2] if command.kp[0] == A1.kp else 15
        down = np.array([label >> foot & 1 for foot in range(4)])
        self.state.foot_force[:] = 100 * down
        # a calf's torque alone can tell a load, and moves nothing: there is no physics
        newtons = LegForce(A1).step(self.state.q, np.tile([0.0, 0, 1], 4), np.array([0.0, 0, -1]))
        self.state.tau[2::3] = (15.0 * down / newtons).clip(-20, 20)
        return BOARD.encode_state(self.state)

    @property
    def damped(self) -> bool:
        return self.last is not None and not self.last.kp.any() and (self.last.kd > 0).all()


class VirtualClock:
    """Time that passes when the loop sleeps, and a little when it looks."""

    def __init__(self) -> None:
        self.now = 0

    def monotonic_ns(self) -> int:
        self.now += 10_000
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture(scope="session")
def bundle_path(tmp_path_factory) -> Path:
    return write_bundle(tmp_path_factory.mktemp("bundle") / "trot.onnx")


@pytest.fixture
def bundle(bundle_path) -> Bundle:
    return load_bundle(bundle_path)


@pytest.fixture
def brisk() -> RuntimeSettings:
    """All movements in tenths of a second, and commands at once.

    That the machine is busy with other tests is no fault of the robot's, nor that its joints move
    without torques, nor that its feet, which keep one pace, then miss a c_f or two.
    """
    return RuntimeSettings(
        safety=Safety(missed_ticks=400, torque_error=100, stuck=10),
        link=LinkSettings(startup_timeout=0.3),
        steering=Steering(acceleration=1000, turning=1000, frequency=1000),
        motion=Motion(crouch=0.2, rise=0.2, settle=0.1, slow_down=0.1, sit=0.2),
    )


@pytest.fixture
def robot() -> KinematicRobot:
    return KinematicRobot()


@pytest.fixture
def make_bundle(tmp_path):
    """Writes a bundle with a changed contract or network; returns its path."""

    def make(model: onnx.ModelProto | None = None, **changes) -> Path:
        return write_bundle(tmp_path / "trot.onnx", model, **changes)

    return make


@pytest.fixture
def make_network():
    return network
