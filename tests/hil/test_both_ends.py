"""What the robot measures is what the daemon reads, and what the daemon commands is what motors do.

Each end has a codec of its own, so a field that one of them has wrong shows here, and so does a
robot that counts its joints the other way than the vendor's.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

import struct
from pathlib import Path

import numpy as np
import pytest

from rmll_hil.faults.fault_trial import MOTION
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.fault_plan import parse_plan
from rmll_hil.robot.robot_packets import A1Robot
from rmll_hil.robot.sensors import FOOT_BIAS, FOOT_GAIN, MOTOR_TEMPERATURE, QUIET
from rmll_hil.runs import lockstep, metrics
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.protocol import a1_remote
from rmll_onboard.protocol.a1_packets import decode_state, encode_command
from rmll_onboard.protocol.a1_remote import Button
from rmll_onboard.settings.runtime_settings import Motion, RuntimeSettings
from rmll_onboard.state.robot_state import MotorCommand
from rmll_robots import A1

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
FALLING = MotorCommand(
    mode=np.full(12, 0x0A, np.uint8),
    q=np.linspace(-1.2, 1.0, 12),
    dq=np.linspace(0.3, -0.8, 12),
    tau=np.linspace(-3.0, 2.5, 12),
    kp=np.linspace(20.0, 31.0, 12),
    kd=np.linspace(0.5, 6.0, 12),
)
"""All of it different, and nothing that the wire would round"""


def test_the_motors_do_what_the_daemon_commands() -> None:
    emulator = Emulator(noise=QUIET)
    assert emulator.receive(encode_command(FALLING))
    emulator.advance(6, 0)
    model, command = emulator.world.model, FALLING
    wanted = command.tau + command.kp * command.q + command.kd * command.dq
    np.testing.assert_allclose(-model.actuator_biasprm[:, 1], command.kp, atol=1 / 32)
    np.testing.assert_allclose(-model.actuator_biasprm[:, 2], command.kd, atol=1 / 16)
    np.testing.assert_allclose(emulator.world.data.ctrl, wanted, atol=0.1)
    assert (emulator.board.mode == 0x0A).all()


def test_the_daemon_reads_what_the_robot_measures() -> None:
    plan = parse_plan(
        [
            {"fault": "remote", "buttons": ["A", "L2"], "lx": 0.1, "ly": 0.2, "rx": 0.3, "ry": 0.4},
            {"fault": "hot_joint", "joint": "FL_thigh_joint", "rate": 100},
        ],
        A1,
    )
    emulator = Emulator(noise=QUIET, plan=plan)
    emulator.world.data.qpos[3:7] = 0.9, 0.1, 0.3, 0.2
    emulator.receive(encode_command(FALLING))
    emulator.advance(40, 0)
    state, world = decode_state(emulator.state_datagram()), emulator.world
    for read, measured, width in (
        (state.q, world.q, 1e-6),
        (state.dq, world.dq, 1e-5),
        (state.tau, world.torque, 1 / 256),
        (state.quaternion, world.quaternion, 1e-6),
        (state.gyro, world.gyro, 1e-5),
        (state.accelerometer, world.accelerometer, 1e-3),
    ):
        assert len({*np.round(measured, 4).tolist()}) == len(measured)
        np.testing.assert_allclose(read, measured, atol=width)
    w, x, y, z = world.quaternion
    assert np.tan(state.rpy[0]) == pytest.approx((w * x + y * z) / (0.5 - x * x - y * y), rel=1e-5)
    assert np.sin(state.rpy[1]) == pytest.approx(2 * (w * y - z * x), abs=1e-6)
    assert state.mode.tolist() == [0x0A] * 12
    expected = [MOTOR_TEMPERATURE] * 12
    expected[4] += 4  # 100 °C/s for 40 ms
    assert state.temperature.tolist() == expected
    assert state.tick == 40
    held = a1_remote.decode(state.remote)
    assert held.buttons == Button.A | Button.L2
    sticks = held.lx, held.ly, held.rx, held.ry
    assert sticks == pytest.approx((0.1, 0.2, 0.3, 0.4))


def test_the_daemon_reads_each_foot_s_load() -> None:
    emulator = Emulator(noise=QUIET)
    emulator.world.foot_load[:] = 10.0, 20.0, 40.0, 80.0
    for _ in range(2000):  # the rubber creeps
        emulator.sensors.feet.read(emulator.world.foot_load, 0.002)
    state = decode_state(emulator.state_datagram())
    expected = FOOT_GAIN * emulator.world.foot_load + FOOT_BIAS
    np.testing.assert_allclose(state.foot_force, expected, atol=0.6)


def flipped(joint: str) -> Emulator:
    """A robot on whose wire one joint counts the other way round."""
    signs = [-1 if name == joint else 1 for name in A1.joint_names]
    return Emulator(EmulatorSettings(seed=1), QUIET, wire=A1Robot(signs))


@pytest.mark.parametrize("slot", range(12))
def test_a_joint_that_counts_the_other_way_shows_in_the_packets(slot: int) -> None:
    """So that ``test_joint_convention.py`` can fail."""
    usual, other = Emulator(EmulatorSettings(seed=1), QUIET), flipped(A1.joint_names[slot])
    joint = 63 + 32 * slot
    for emulator in (usual, other):
        emulator.world.q[:] = emulator.world.dq[:] = -0.7
    angles = [
        struct.unpack_from("<ff", each.state_datagram(), joint + 1) for each in (usual, other)
    ]
    np.testing.assert_allclose(angles, [[-0.7, -0.7], [0.7, 0.7]])
    apart = [a != b for a, b in zip(usual.state_datagram(), other.state_datagram(), strict=True)]
    assert not any(apart[63:joint] + apart[joint + 32 : 763])
    for emulator in (usual, other):
        emulator.receive(encode_command(FALLING))
        emulator.advance(6, 0)
    bias = [emulator.world.data.ctrl[slot] for emulator in (usual, other)]
    assert bias[1] == pytest.approx(-bias[0], abs=1e-9)


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        ("FR_calf_joint", "FR_calf_joint at 2.70 rad, 3.61 rad past its limit"),
        ("RL_thigh_joint", "tilted"),
    ],
)
def test_a_joint_that_counts_the_other_way_stops_the_daemon(joint: str, words: str) -> None:
    assert words in (walked(flipped(joint)).fault or "")


def test_a_hip_that_counts_the_other_way_turns_the_robot_from_its_course() -> None:
    """The daemon cannot see it; whoever looks at the figures does."""
    assert walked(Emulator(EmulatorSettings(seed=1), QUIET)).wz_error < 0.2
    assert walked(flipped("FR_hip_joint")).wz_error > 0.4


def walked(emulator: Emulator) -> metrics.RunSummary:
    bundle = load_bundle(TROT)
    operator = FlagOperator(bundle.table.commands, 0.5, seconds=2.0)
    settings = RuntimeSettings(motion=Motion(**MOTION))
    outcome = lockstep.walk(emulator, bundle, operator, lambda _: None, settings=settings)
    return metrics.summary(outcome, "trot", A1)
