"""The whole runtime, datagram in and datagram out, on a robot without physics."""

import math
import socket
import struct
from functools import partial

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rmll_gaits.load import load_gait
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_hil.robot.a1_joystick import press
from rmll_onboard.commands.command_socket import SocketOperator
from rmll_onboard.commands.operator import FlagOperator, OperatorCommand, RemoteOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.settings.runtime_settings import Steering
from rmll_onboard.state.modes import Mode, Request
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import A1

BOARD = A1BoardPackets()
WALK = (0.5, 0.0, 8.0)
remote = partial(press, head=bytes(2))


class Lockstep:
    """A daemon and a robot, a tick each, on a clock of their own."""

    def __init__(self, daemon, robot):
        self.daemon, self.robot = daemon, robot
        self.now = 0
        self.answer = None
        self.sent = []

    def tick(self, datagram=...):
        """One period; ``datagram`` replaces what the robot answered."""
        self.now += self.daemon.period
        datagram = self.answer if datagram is ... else datagram
        command = self.daemon.tick(self.now, [] if datagram is None else [datagram])
        self.sent.append(command)
        self.answer = self.robot.answer(command)

    def run(self, seconds):
        for _ in range(round(seconds * 200)):
            if self.daemon.finished:
                break
            self.tick()

    def until_walking(self):
        while not self.daemon.policy_ran:
            assert self.now < 3e9
            self.tick()
        return self


def by_command(seconds: float) -> FlagOperator:
    return FlagOperator(load_gait("trot").commands, *WALK, seconds)


@pytest.fixture
def by_flags(bundle, brisk, robot):
    return Lockstep(Daemon(bundle, brisk, by_command(2.0)), robot)


@pytest.fixture
def by_remote(bundle, brisk, robot):
    operator = RemoteOperator(bundle.table.commands, 9, brisk.steering.deadband)
    return Lockstep(Daemon(bundle, brisk, operator), robot)


def test_a_walk_by_flags_from_start_to_end(by_flags, robot):
    by_flags.run(10)
    daemon = by_flags.daemon
    report = daemon.report()
    assert daemon.finished
    assert robot.damped
    assert report.fault is None
    assert report.policy_steps == 101
    assert report.walking_end_ns - report.walking_start_ns == 2_000_000_000
    assert report.transitions == pytest.approx(report.allowed, abs=1.5)
    assert report.adherence == pytest.approx(1, abs=0.15)
    assert report.off_spec_contact < 0.15  # all feet down for a step at each change
    assert (daemon.interface.rejected, daemon.interface.lost) == (0, 0)


def test_two_runs_send_the_same_bytes(bundle, brisk, robot):
    runs = []
    for _ in range(2):
        robot.__init__()
        lockstep = Lockstep(Daemon(bundle, brisk, by_command(0.5)), robot)
        lockstep.run(5)
        runs.append(lockstep.sent)
    assert runs[0] == runs[1]


def test_targets_follow_the_policy_at_its_rate_and_in_the_robots_order(make_bundle, brisk, robot):
    names = A1.joint_names[6:] + A1.joint_names[:6]
    pose = np.array([A1.default_pose[A1.joint_names.index(name)] for name in names])
    path = make_bundle(joint_names=names, default_pose=tuple(pose.tolist()), action_scale=1e-6)
    lockstep = Lockstep(Daemon(load_bundle(path), brisk, by_command(1.0)), robot)
    lockstep.until_walking()
    ran = []
    for _ in range(40):
        lockstep.tick()
        ran.append(lockstep.daemon.policy_ran)
    assert ran == [False, False, False, True] * 10
    np.testing.assert_allclose(robot.last.q, A1.default_pose, atol=1e-4)


def test_the_remote_leads_through_a_walk(by_remote, robot):
    def hold(buttons, seconds, **sticks):
        robot.state.remote = remote(*buttons, **sticks)
        by_remote.run(seconds)
        return by_remote.daemon.policy_ran, float(robot.last.kp[0])

    assert hold([], 0.5)[1] == 0
    assert hold(["A"], 0.5)[1] == 0  # does not walk from the ground
    assert hold(["B"], 0.5)[1] == 0  # nor stand up by the button that ends a walk
    assert hold(["START"], 1.0)[1] == A1.stand_kp
    assert hold(["A"], 0.5, ly=1.0, rx=-0.5)[1] == A1.kp
    before = by_remote.daemon.report()
    assert hold(["START"], 0.5)[1] == A1.kp  # START does not end it
    assert hold(["B"], 0.5)[1] == A1.stand_kp
    assert hold(["SELECT"], 0.5)[1] == 0
    assert robot.damped
    assert not by_remote.daemon.finished
    assert by_remote.daemon.report().policy_steps > before.policy_steps
    assert hold(["START"], 1.0)[1] == A1.stand_kp  # and once more


@pytest.mark.parametrize("walking", [False, True])
def test_l2_and_b_stop_for_good(by_remote, robot, walking):
    if walking:
        robot.state.remote = remote("START", "A")
        by_remote.until_walking()
    robot.state.remote = remote("L2", "B")
    by_remote.run(0.02)
    assert robot.damped
    assert by_remote.daemon.fault == "emergency stop on the remote"
    robot.state.remote = remote("START")
    by_remote.run(1)
    assert robot.damped


def bad_stick(robot, value):
    robot.state.remote = bytes(4) + struct.pack("<f", value) + bytes(32)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_stick_that_is_no_number_is_a_bad_packet_and_damps(by_remote, robot, value):
    robot.state.remote = remote("START", "A", ly=0.5)
    by_remote.until_walking()
    bad_stick(robot, value)
    by_remote.run(0.1)
    daemon = by_remote.daemon
    assert daemon.fault.startswith("no state from the robot")
    assert "not finite" in daemon.fault
    assert daemon.report().refused["not finite"] > 10
    assert robot.damped


def test_a_robot_whose_remote_is_no_number_from_the_start_is_not_believed(by_remote, robot):
    bad_stick(robot, math.nan)
    by_remote.run(0.5)
    assert by_remote.daemon.interface.received == 0
    assert by_remote.daemon.interface.refused["not finite"] > 50
    assert robot.damped


def test_a_stick_that_strays_at_rest_does_not_creep(by_remote, robot):
    robot.state.remote = remote("START", "A", ly=0.03, rx=-0.03)
    by_remote.until_walking()
    robot.state.remote = remote(ly=0.03, rx=-0.03)
    by_remote.run(0.5)
    assert by_remote.daemon.controller.command[:2].tolist() == [0, 0]
    assert by_remote.daemon.mode is Mode.WALKING


@pytest.mark.parametrize("rest", [remote(ly=-0.0, lx=0.03), bytes(39) + b"\x07"])
def test_a_resting_remote_is_not_lost(by_remote, robot, rest):
    robot.state.remote = remote("START", "A", ly=0.5)
    by_remote.until_walking()
    robot.state.remote = rest
    by_remote.run(25)
    assert by_remote.daemon.mode is Mode.WALKING
    assert not any("remote" in told for told in by_remote.daemon.report().warnings)


def test_stopping_sits_down_and_finishes(by_flags, robot):
    by_flags.until_walking()
    by_flags.daemon.stopping = True
    by_flags.run(0.09)
    assert robot.last.kp[0] == A1.kp  # on the spot first
    by_flags.run(0.02)
    assert robot.last.kp[0] == A1.stand_kp
    by_flags.run(1)
    assert by_flags.daemon.finished
    assert robot.damped


class Script:
    """An operator who wants what the test sets."""

    by_remote = False
    complaint = None

    def __init__(self, frequency=12.0):
        self.wanted = OperatorCommand(Request.STAND, (0.0, 0.0, frequency))

    def orders(self, now, mode, remote):
        return self.wanted

    def finished(self, mode, fault):
        return False


def test_commands_reach_the_policy_gradually(bundle, brisk, robot):
    settings = msgspec.structs.replace(brisk, steering=Steering())
    operator = Script()
    lockstep = Lockstep(Daemon(bundle, settings, operator), robot)
    lockstep.run(0.4)
    operator.wanted = OperatorCommand(Request.WALK, (1.0, 0.0, 12.0))
    lockstep.until_walking()
    told = [lockstep.daemon.controller.command.tolist()]

    def walk(seconds):
        for _ in range(round(seconds * 200)):
            lockstep.tick()
            if lockstep.daemon.policy_ran:
                told.append(lockstep.daemon.controller.command.tolist())

    walk(1.0)
    assert told[0] == pytest.approx([0.04, 0.0, 12.0])  # from rest, at the pace that is wanted
    assert told[-1] == [1.0, 0.0, 12.0]
    operator.wanted = OperatorCommand(None, (-9.0, 0.0, 1.0))
    walk(2.0)
    assert told[-1] == [-1.0, 0.0, 6.0]
    limits = Steering().acceleration / 50, Steering().turning / 50, Steering().frequency / 50
    assert (np.abs(np.diff(told, axis=0)) <= np.array(limits) + 1e-9).all()


def test_an_operator_can_damp_for_good(bundle, brisk, robot):
    operator = Script()
    lockstep = Lockstep(Daemon(bundle, brisk, operator), robot)
    lockstep.run(0.4)
    operator.wanted = OperatorCommand(Request.DAMP, (0.0, 0.0, 9.0))
    lockstep.run(0.01)
    assert robot.damped
    operator.wanted = OperatorCommand(Request.STAND, (0.0, 0.0, 9.0))
    lockstep.run(1.0)
    assert robot.damped
    assert lockstep.daemon.fault == "emergency stop by the operator"


def test_a_program_that_falls_silent_leaves_a_standing_robot(bundle, brisk, robot, tmp_path):
    operator = SocketOperator(tmp_path / "commands", frequency=9.0, silence=0.3)
    lockstep = Lockstep(Daemon(bundle, brisk, operator), robot)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as program:
        for message in [b'{"request": "stand"}'] * 4 + [b'{"request": "walk", "vx": 0.5}'] * 5:
            program.sendto(message, str(tmp_path / "commands"))
            lockstep.run(0.1)
    assert lockstep.daemon.mode is Mode.WALKING
    assert lockstep.daemon.controller.command.tolist() == [0.5, 0.0, 9.0]
    lockstep.run(0.6)
    assert lockstep.daemon.mode is Mode.STANDING
    report = lockstep.daemon.report()
    assert report.fault is None
    assert any("no message" in warning for warning in report.warnings)
    operator.close()


def test_nothing_moves_before_the_robot_was_heard(by_flags, robot):
    for _ in range(200):
        by_flags.tick(None)
        assert robot.damped
    assert (by_flags.daemon.mode, by_flags.daemon.fault) == (Mode.DAMPING, None)
    by_flags.until_walking()


def silence(lockstep):
    return None


def corruption(lockstep):
    return lockstep.answer[:100] + b"\xff" + lockstep.answer[101:]


def fall(lockstep):
    lockstep.robot.state.quaternion[:] = [np.cos(0.8), np.sin(0.8), 0, 0]
    return BOARD.encode_state(lockstep.robot.state)


def dead_imu(lockstep):
    lockstep.robot.state.quaternion[:] = 0
    return BOARD.encode_state(lockstep.robot.state)


def huge_numbers(lockstep):
    lockstep.robot.state.dq[:] = 3e38
    return BOARD.encode_state(lockstep.robot.state)


@pytest.mark.parametrize(
    ("break_it", "fault"),
    [
        (silence, "no state"),
        (corruption, "no state"),
        (fall, "tilted: roll 1.60"),
        (dead_imu, "no orientation: its quaternion is [0.0, 0.0, 0.0, 0.0]"),
        (huge_numbers, "speeds that no joint"),
    ],
    ids=lambda value: getattr(value, "__name__", value),
)
def test_a_fault_while_walking_ends_in_damping(by_flags, robot, break_it, fault):
    by_flags.until_walking()
    for _ in range(20):
        by_flags.tick(break_it(by_flags))
    assert fault in by_flags.daemon.fault
    assert robot.damped
    assert by_flags.daemon.finished  # by flags; with the remote it goes on damping


def test_huge_rates_from_the_imu_do_not_reach_the_joints(by_flags, robot):
    by_flags.until_walking()
    robot.state.gyro[:] = 3e38
    for _ in range(20):
        by_flags.tick()
        assert np.abs(robot.last.q[robot.last.kp > 0]).max(initial=0) < 5


@pytest.mark.fuzz
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_hostile_datagrams_change_nothing(bundle, brisk, data):
    daemon = Daemon(bundle, brisk, by_command(1.0))
    good = BOARD.encode_state(RobotState(quaternion=np.array([1.0, 0, 0, 0])))
    daemon.tick(0, [good])
    flips = st.tuples(st.integers(0, 763), st.integers(0, 7))
    hostile = st.binary(max_size=1200) | flips.map(
        lambda flip: good[: flip[0]] + bytes([good[flip[0]] ^ 1 << flip[1]]) + good[flip[0] + 1 :]
    )
    for count in range(5):
        daemon.tick((count + 1) * daemon.period, [data.draw(hostile)])
    interface = daemon.interface
    assert (interface.received, interface.rejected, interface.lost) == (1, 5, 5)
