"""The robot's side: each stage of a policy tick, and the whole, beside bare onnxruntime.

Back to back, with warm caches; a real 50 Hz tick is slower (see ``tick_us`` of ``rmll-hil run``).
"""

from pathlib import Path

import numpy as np
import pytest

from rmll_onboard import a1_wire
from rmll_onboard.bundle import Bundle, load_bundle
from rmll_onboard.controller import Controller, prove
from rmll_onboard.daemon import Daemon
from rmll_onboard.pilot import FlagPilot
from rmll_onboard.settings import Settings
from rmll_robots import A1

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    return load_bundle(TROT)


@pytest.fixture
def state() -> bytes:
    """A robot that stands at its default pose."""
    standing = a1_wire.RobotState()
    standing.q[:] = A1.default_pose
    standing.quaternion[:] = [1.0, 0.0, 0.0, 0.0]
    standing.foot_force[:] = 60
    return a1_wire.encode_state(standing)


def test_bare_onnxruntime(benchmark, bundle: Bundle) -> None:
    size = bundle.session.get_inputs()[0].shape[1]
    observation = np.zeros((1, size), np.float32)
    benchmark(bundle.session.run, None, {"observation": observation})


def test_controller_step(benchmark, bundle: Bundle) -> None:
    controller = Controller(bundle)
    feet, joints = np.ones(4, bool), A1.default_pose.copy()
    gravity, gyro, command = np.array([0.0, 0.0, -1.0]), np.zeros(3), (0.5, 0.0, 9.0)
    benchmark(controller.step, feet, ~feet, joints, np.zeros(12), gravity, gyro, command)


def test_policy_period_from_datagrams_to_datagrams(benchmark, bundle: Bundle, state: bytes) -> None:
    """A policy period: four states in, four commands out, one of them by the policy."""
    pilot = FlagPilot(bundle.table.commands, vx=0.5)
    daemon = Daemon(bundle, Settings(), pilot)
    now = 0

    def policy_period() -> bytes:
        nonlocal now
        answer = b""
        for _ in range(4):
            now += daemon.period
            answer = daemon.tick(now, state)
            if daemon.policy_ran:
                break
        return answer

    while not daemon.policy_ran:
        policy_period()
    benchmark(policy_period)


def test_proving_a_bundle(benchmark, bundle: Bundle) -> None:
    benchmark(prove, bundle)


def test_crc(benchmark, state: bytes) -> None:
    benchmark(a1_wire.crc, state[: a1_wire.protected(len(state))])


def test_decode_state(benchmark, state: bytes) -> None:
    benchmark(a1_wire.decode_state, state, a1_wire.RobotState())


def test_encode_command(benchmark) -> None:
    benchmark(a1_wire.encode_command, a1_wire.MotorCommand())
