"""The safety states."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.protocol.a1_packets import encode_command
from rmll_onboard.safety.faults import Complaint, Fault
from rmll_onboard.safety.supervisor import Supervisor
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.modes import NS, Mode, Request
from rmll_onboard.state.robot_state import MODE_SERVO, POS_STOP, RobotState
from rmll_robots import A1

BOARD = A1BoardPackets()
PERIOD = NS // 200
MOTION = RuntimeSettings().motion

SOMETHING = Complaint(Fault.TILTED, "it hangs upside down")


class Bench:
    """A supervisor, a robot that follows its targets at once, and a clock."""

    def __init__(self, q=A1.crouch_pose):
        self.supervisor = Supervisor(
            A1, RuntimeSettings(), A1.default_pose, (A1.kp, A1.kd), A1.torque_limit
        )
        self.state = RobotState(q=np.array(q))
        self.target = A1.default_pose + 0.1
        self.complaint = None
        self.now = 0

    def tick(self, request=None):
        self.now += PERIOD
        self.supervisor.update(self.now, self.state, request)
        if self.complaint:
            self.supervisor.trip(self.complaint)
        self.command = self.supervisor.command(self.now, self.state, self.target)
        if self.command.kp.any():
            self.state.q[:] = self.command.q
        return self.supervisor.mode

    def run(self, seconds, request=None):
        for _ in range(round(seconds * 200)):
            self.tick(request)
        return self.supervisor.mode

    def walk(self):
        """Up to walking; returns itself."""
        self.run(MOTION.crouch + MOTION.rise + MOTION.settle + 0.1, Request.STAND)
        self.tick(Request.WALK)
        assert self.supervisor.mode is Mode.WALKING
        return self

    @property
    def damped(self):
        command = self.command
        return (
            (command.mode == MODE_SERVO).all()
            and not command.kp.any()
            and not command.tau.any()
            and (command.q == POS_STOP).all()
            and (command.kd == A1.damping_kd).all()
        )


def test_it_stands_up_walks_and_sits_down():
    bench = Bench()
    assert bench.tick() is Mode.DAMPING
    assert bench.damped
    assert bench.tick(Request.STAND) is Mode.STANDING_UP
    assert bench.run(MOTION.crouch + MOTION.rise) is Mode.STANDING_UP
    assert bench.run(MOTION.settle + 0.1) is Mode.STANDING
    np.testing.assert_allclose(bench.state.q, A1.default_pose)
    assert bench.command.kp[0] == A1.stand_kp
    assert bench.tick(Request.WALK) is Mode.WALKING
    assert (bench.command.kp[0], bench.command.kd[0]) == (A1.kp, A1.kd)
    np.testing.assert_allclose(bench.command.q, bench.target)
    assert bench.run(1.0) is Mode.WALKING
    assert bench.tick(Request.SIT) is Mode.SITTING_DOWN
    assert bench.run(MOTION.sit + 0.1) is Mode.DAMPING
    np.testing.assert_allclose(bench.state.q, A1.crouch_pose, atol=1e-3)
    assert bench.damped
    assert bench.supervisor.fault is None


def test_rising_starts_softly_from_the_measured_pose():
    pose = A1.stand_pose + 0.2
    bench = Bench(pose)
    bench.tick(Request.STAND)
    np.testing.assert_allclose(bench.command.q, pose, atol=1e-3)
    assert 0 < bench.command.kp[0] < 0.05 * A1.stand_kp
    poses, gains = [], []
    while bench.tick() is Mode.STANDING_UP:
        poses.append(bench.command.q.copy())
        gains.append(bench.command.kp[0])
    assert np.abs(np.diff(poses, axis=0)).max() < 0.02
    assert (np.diff(gains) >= 0).all()
    assert gains[-1] == A1.stand_kp


def test_all_the_strength_is_there_once_the_legs_are_folded():
    bench = Bench(A1.stand_pose)
    bench.run(MOTION.crouch + 2 / 200, Request.STAND)
    assert bench.command.kp[0] == A1.stand_kp


def test_a_walk_can_end_in_standing_and_go_on():
    bench = Bench().walk()
    assert bench.tick(Request.STAND) is Mode.STANDING
    assert bench.tick(Request.WALK) is Mode.STANDING  # not before the pose is reached
    bench.run(MOTION.settle)
    assert bench.tick(Request.WALK) is Mode.WALKING


@pytest.mark.parametrize(
    ("mode", "ignored"),
    [
        (Mode.DAMPING, [Request.WALK, Request.SIT]),
        (Mode.STANDING_UP, [Request.STAND, Request.WALK]),
        (Mode.STANDING, [Request.STAND]),
        (Mode.SITTING_DOWN, [Request.STAND, Request.WALK, Request.SIT]),
    ],
)
def test_what_a_mode_does_not_allow_is_ignored(mode, ignored):
    for request in ignored:
        bench = Bench()
        if mode is Mode.STANDING_UP:
            bench.tick(Request.STAND)
        if mode in (Mode.STANDING, Mode.SITTING_DOWN):
            bench.walk().tick(Request.STAND)
        if mode is Mode.SITTING_DOWN:
            bench.tick(Request.SIT)
        assert bench.tick(request) is mode


def test_a_complaint_damps_for_good():
    bench = Bench().walk()
    bench.complaint = SOMETHING
    bench.tick()
    assert bench.damped
    assert bench.supervisor.fault == SOMETHING
    bench.complaint = None
    for request in Request:
        assert bench.run(0.1, request) is Mode.DAMPING
        assert bench.damped


def test_a_damped_robot_may_be_complained_of_but_not_lifted():
    bench = Bench()
    bench.complaint = SOMETHING
    bench.run(1.0)
    assert bench.supervisor.fault is None
    assert bench.tick(Request.STAND) is Mode.DAMPING
    assert bench.supervisor.fault == SOMETHING


def test_the_first_fault_is_the_one_told():
    bench = Bench().walk()
    bench.supervisor.trip(SOMETHING)
    bench.supervisor.trip(Complaint(Fault.POWER, "later"))
    assert bench.supervisor.fault == SOMETHING


joints = hnp.arrays(np.float64, 12, elements=st.floats(-4, 4))


@cache
def walking():
    """One for all examples: a command of a walk depends on nothing before it."""
    return Bench().walk()


@settings(deadline=None)
@given(joints, joints.map(lambda a: 5 * a), hnp.arrays(np.float64, 12, elements=st.floats(-9, 9)))
def test_no_target_asks_for_more_than_the_torque_limit(q, dq, target):
    bench = walking()
    bench.state.q[:], bench.state.dq[:] = q, dq
    bench.target = target
    command = bench.supervisor.command(bench.now, bench.state, bench.target)
    command = BOARD.decode_command(encode_command(command))  # as the robot gets it, in 32 bits
    torque = command.kp * (command.q - q) - command.kd * dq
    assert (np.abs(torque) <= A1.torque_limit + 1e-4).all()
    reachable = (np.abs(torque) < A1.torque_limit - 1e-4).nonzero()
    assert (command.q[reachable] >= A1.joint_lower[reachable] - 1e-6).all()
    assert (command.q[reachable] <= A1.joint_upper[reachable] + 1e-6).all()
