"""Parts of the robot's side on their own, back to back; test_bench_tick.py has the whole."""

import numpy as np
import pytest

from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.control.bundle import Bundle
from rmll_onboard.control.controller import Controller, PolicyInput, prove
from rmll_onboard.protocol import a1_packets
from rmll_robots import A1


@pytest.fixture
def state() -> bytes:
    """A robot that stands at its default pose."""
    standing = a1_packets.RobotState()
    standing.q[:] = A1.default_pose
    standing.quaternion[:] = [1.0, 0.0, 0.0, 0.0]
    standing.foot_force[:] = 60
    return A1BoardPackets().encode_state(standing)


def test_bare_onnxruntime(benchmark, bundle: Bundle) -> None:
    size = bundle.session.get_inputs()[0].shape[1]
    observation = np.zeros((1, size), np.float32)
    benchmark(bundle.session.run, None, {"observation": observation})


def test_controller_step(benchmark, bundle: Bundle) -> None:
    controller = Controller(bundle)
    feet, joints = np.ones(4, bool), A1.default_pose.copy()
    sensed = PolicyInput(joints, np.zeros(12), np.array([0.0, 0.0, -1.0]), np.zeros(3))
    benchmark(controller.step, feet, ~feet, sensed, (0.5, 0.0, 9.0))


def test_proving_a_bundle(benchmark, bundle: Bundle) -> None:
    benchmark(prove, bundle)


def test_crc(benchmark, state: bytes) -> None:
    benchmark(a1_packets.crc, state[: a1_packets.protected(len(state))])


def test_decode_state(benchmark, state: bytes) -> None:
    benchmark(a1_packets.StateDecoder().decode, state)


def test_encode_command(benchmark) -> None:
    benchmark(a1_packets.CommandEncoder().encode, a1_packets.MotorCommand())
