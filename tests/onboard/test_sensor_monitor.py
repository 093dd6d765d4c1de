"""Which sensors are believed, and how soon one that is wrong is told."""

import re
from collections.abc import Callable
from functools import cache
from math import pi
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmll_onboard.safety.attitude_monitor import GRAVITY, AttitudeMonitor
from rmll_onboard.safety.joint_monitor import JointMonitor
from rmll_onboard.safety.sensor_monitor import SensorMonitor
from rmll_onboard.settings.runtime_settings import Safety
from rmll_onboard.state.robot_state import RobotState, Streams
from rmll_robots import A1

PERIOD = 5_000_000
"""[ns]"""
ALL = Streams(accelerometer=True, rpy=True)
Change = Callable[[RobotState], None]


def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Of quaternions."""
    w, x, y, z = one
    a, b, c, d = other
    return np.array(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ]
    )


class Truth(NamedTuple):
    """Of the 100 ticks of a swing, after which it begins anew."""

    q: np.ndarray
    dq: np.ndarray
    quaternion: np.ndarray
    gyro: np.ndarray
    accelerometer: np.ndarray
    rpy: np.ndarray


def pose(swing: float, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint angles, orientations (4, ticks), and roll, pitch and yaw (3, ticks)."""
    phases = 2 * pi * 2.0 * seconds[:, None] + np.arange(12)
    rpy = swing / 3 * np.sin(phases[:, :3].T)
    roll, pitch, yaw = (
        np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis[:, None])])
        for angle, axis in zip(rpy, np.eye(3), strict=True)
    )
    return A1.default_pose + swing * np.sin(phases), product(product(yaw, pitch), roll), rpy


@cache
def truth(swing: float) -> Truth:
    """Sensors that agree: the rates are the derivatives of the angles."""
    seconds, step = np.arange(100) * 0.005, 1e-5
    q_later, later, _ = pose(swing, seconds + step)
    q_before, before, _ = pose(swing, seconds - step)
    q, quaternion, rpy = pose(swing, seconds)
    turned = product(quaternion * [[1], [-1], [-1], [-1]], (later - before) / (2 * step))
    w, x, y, z = quaternion
    up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), w * w + z * z - x * x - y * y])
    dq = (q_later - q_before) / (2 * step)
    return Truth(q, dq, quaternion.T, 2 * turned[1:].T, GRAVITY * up.T, rpy.T)


class Body:
    """A base that rolls, pitches and yaws while its joints swing; every sensor tells the truth."""

    def __init__(self, swing: float = 0.3, streams: Streams = ALL, **safety: float):
        self.monitor = SensorMonitor(A1, Safety(**safety), streams, 1e-3)
        self.truth = truth(swing)
        """Joints swing by so many [rad], the base by a third of it"""
        self.ticks = 0
        self.change: Change = lambda state: None
        self.moving = swing > 0

    def state(self) -> RobotState:
        trembling = 1e-4 * (self.ticks % 7)
        row = self.ticks % 100
        now = Truth(*(rows[row] + trembling for rows in self.truth))
        now = now._replace(quaternion=self.truth.quaternion[row].copy())
        tau = np.full(12, trembling)
        return RobotState(tau=tau, tick=self.ticks * 5 & 0xFFFFFFFF, **now._asdict())

    def tick(self) -> str | None:
        self.ticks += 1
        state = self.state()
        self.change(state)
        self.monitor.measure(self.now, state, self.moving, self.moving)
        return self.monitor.fault

    @property
    def now(self) -> int:
        return self.ticks * PERIOD

    def well(self, ticks: int = 200) -> "Body":
        for _ in range(ticks):
            assert self.tick() is None
        return self

    def until_fault(self, most: int) -> str:
        for _ in range(most):
            if told := self.tick():
                return told
        return "no fault"

    def frozen(self, *fields: str) -> None:
        """These go on with what they read now."""
        last = self.state()

        def change(state: RobotState) -> None:
            for name in fields:
                getattr(state, name)[:] = getattr(last, name)

        self.change = change


def zero(*fields: str) -> Change:
    def change(state: RobotState) -> None:
        for name in fields:
            getattr(state, name)[:] = 0

    return change


def scaled(field: str, factor: float) -> Change:
    def change(state: RobotState) -> None:
        getattr(state, field)[:] *= factor

    return change


def swapped(state: RobotState) -> None:
    state.quaternion[:] = state.quaternion[[1, 2, 3, 0]]


def dead_imu(state: RobotState) -> None:
    zero("gyro", "accelerometer", "rpy")(state)
    state.quaternion[:] = 1, 0, 0, 0


@pytest.mark.parametrize("streams", [Streams(True, True), Streams(False, False)])
def test_sensors_that_agree_are_believed(streams: Streams) -> None:
    body = Body(streams=streams).well(2000)
    assert body.monitor.doubt is None
    assert body.monitor.attitude.drift < 0.02
    assert body.monitor.joints.drift < 0.02


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("quaternion", "orientation"),
        ("gyro", "gyroscope"),
        ("q", "joint angles"),
        ("dq", "joint speeds"),
        ("tau", "joint torques"),
    ],
)
def test_what_is_frozen_alone_is_a_fault_within_two_tenths_of_a_second(field, told) -> None:
    body = Body().well()
    body.frozen(field)
    fault = body.until_fault(40)
    both = {"quaternion": "orientation and", "gyro": "and gyroscope", "q": "angle", "dq": "speed"}
    assert told in fault or both.get(field, "-") in fault


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        (("quaternion", "gyro", "accelerometer", "rpy"), "orientation"),
        (("q", "dq"), "joint angles"),
        (("gyro",), "gyroscope"),
        (("dq",), "joint speeds"),
        (("tau",), "joint torques"),
    ],
)
def test_what_is_frozen_together_is_told_by_name(fields, name) -> None:
    body = Body(orientation_error=1000, speed_error=1000).well()
    body.frozen(*fields)
    told = body.until_fault(40)
    assert re.match(
        rf"{name}: the same values for 1[0-4]0 ms, in which the robot turned by 0", told
    )


def spinning(body: Body, rate: float) -> Change:
    """About the vertical, [rad/s], from now on; no joint moves, and its torques do not change."""
    began = body.ticks

    def change(state: RobotState) -> None:
        angle = rate * (body.ticks - began) * 0.005
        state.q[:], state.dq[:] = A1.default_pose + 1e-6 * body.ticks, 1e-6 * body.ticks
        state.quaternion[:] = np.cos(angle / 2), 0, 0, np.sin(angle / 2)
        state.gyro[:] = 0, 1e-4 * (body.ticks % 7), rate
        state.tau[:] = 1.0

    return change


def test_a_base_that_turns_alone_is_motion_too() -> None:
    body = Body(swing=0.0)
    body.change = spinning(body, 1.0)
    told = "joint torques: the same values for 120 ms, in which the robot turned by 0.12 rad"
    assert body.until_fault(60) == told
    # no turn of 0.05 rad in the time that is remembered
    body = Body(swing=0.0)
    body.change = spinning(body, 0.05)
    body.well(400)


def test_values_of_a_robot_at_rest_may_stay_the_same() -> None:
    body = Body(swing=0.0).well(8)
    last = body.state()

    def change(state: RobotState) -> None:
        sign = (-1) ** (body.ticks // 4)  # both are the same orientation
        state.quaternion[:] = sign * last.quaternion
        for name in ("q", "dq", "tau", "gyro", "accelerometer", "rpy"):
            getattr(state, name)[:] = getattr(last, name)

    body.change = change
    body.well(400)
    assert body.monitor.values.spare is None


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (zero("gyro"), "gyroscope"),
        (scaled("gyro", 57.3), "gyroscope"),
        (scaled("gyro", -1.0), "gyroscope"),
        (zero("dq"), "speed"),
        (scaled("dq", -1.0), "speed"),
        (scaled("dq", 57.3), "speed"),
        (swapped, "orientation"),
        (dead_imu, "orientation"),
    ],
)
def test_what_contradicts_the_other_sensors_is_a_fault(wrong: Change, told: str) -> None:
    body = Body(swing=0.5).well()
    body.change = wrong
    assert told in body.until_fault(60)


def test_one_joint_is_named() -> None:
    body = Body().well()

    def change(state: RobotState) -> None:
        state.dq[7] = 0.001 * body.ticks

    body.change = change
    assert A1.joint_names[7] in body.until_fault(60)


def test_a_joint_that_always_reads_the_same_is_told_in_a_walk_alone() -> None:
    body = Body().well()
    last = body.state()

    def stuck(state: RobotState) -> None:
        state.q[4], state.dq[4] = last.q[4], 0.0

    body.change = stuck
    body.well(90)
    assert body.monitor.joints.still(500) is None
    body.well(30)
    joints = body.monitor.joints
    told = f"{A1.joint_names[4]} has read the same for {joints.still_ms:.0f} ms"
    assert 500 < joints.still_ms < 600
    assert joints.still(500) == told
    assert joints.still(np.nextafter(joints.still_ms, 0)) == told
    assert joints.still(joints.still_ms) is None
    body.moving = False
    body.well(8)
    assert joints.still_ms == 0
    # in the next walk it counts from its beginning
    body.moving = True
    body.well(90)
    assert joints.still(500) is None
    body.well(30)
    assert joints.still(500)


@pytest.mark.parametrize("field", ["q", "dq"])
def test_a_joint_is_still_only_if_neither_angle_nor_speed_changes(field: str) -> None:
    body = Body(speed_error=1000).well()
    body.change = lambda state: getattr(state, field).__setitem__(4, 0.5)
    body.well(200)
    assert body.monitor.joints.still_ms < 100


@pytest.mark.parametrize(("field", "joint"), [("gyro", 0), ("gyro", 2), ("dq", 0), ("dq", 11)])
def test_a_single_wrong_rate_ends_nothing(field: str, joint: int) -> None:
    body = Body(swing=0.05).well()
    at = body.ticks + 3

    def change(state: RobotState) -> None:
        if body.ticks == at:
            getattr(state, field)[joint] = 1e6

    body.change = change
    body.well(100)


@pytest.mark.parametrize(
    ("wrong", "sensor", "told"),
    [
        (zero("accelerometer"), "accelerometer", "the accelerometer's mean is"),
        (scaled("accelerometer", 2.0), "accelerometer", "the accelerometer's mean is"),
        (scaled("accelerometer", -1.0), "accelerometer", "about where down is"),
        (zero("rpy"), "rpy", "the orientation is not that of the board's own roll"),
    ],
)
def test_what_a_walk_can_do_without_is_doubted(wrong: Change, sensor: str, told: str) -> None:
    body = Body().well()
    body.change = wrong
    body.well(600)
    assert body.monitor.doubt
    assert body.monitor.doubt[0] == sensor
    assert told in body.monitor.doubt[1]


def test_streams_that_a_robot_has_not_are_not_looked_at() -> None:
    body = Body(streams=Streams(False, False))
    body.change = zero("accelerometer", "rpy")
    for _ in range(400):
        body.well(1)
        assert body.monitor.doubt is None


def test_an_accelerometer_is_averaged_for_longer_in_a_walk() -> None:
    body = Body().well(800)
    body.change = scaled("accelerometer", 0.01)
    body.well(200)
    assert body.monitor.doubt is None
    body.well(300)
    assert body.monitor.doubt is not None
    body = Body(swing=0.0).well(800)
    body.change = scaled("accelerometer", 0.01)
    body.well(40)
    assert body.monitor.unready(body.now) is not None


def test_an_accelerometer_that_is_frozen_is_doubted() -> None:
    body = Body().well()
    body.frozen("accelerometer")
    body.well(60)
    assert body.monitor.doubt
    assert "accelerometer: the same values" in body.monitor.doubt[1]


# --- before standing up ------------------------------------------------------------------------


def lying(change: Change = lambda state: None, seconds: float = 1.0, **options) -> str | None:
    body = Body(swing=0.0, **options)
    body.change = change
    for _ in range(round(seconds * 200)):
        body.tick()
    return body.monitor.unready(body.now)


def test_a_lying_robot_whose_sensors_agree_may_stand_up() -> None:
    assert lying() is None
    assert lying(seconds=4.0) is None
    assert lying(streams=Streams(False, False)) is None


def leant_and_scaled(state: RobotState) -> None:
    """More wrong in its direction than in its length."""
    state.accelerometer[:] = 1.09 * GRAVITY * np.array([np.sin(0.2), 0, np.cos(0.2)])


def tilted_accelerometer(state: RobotState) -> None:
    state.accelerometer[:] = GRAVITY * np.sin(0.4), 0, GRAVITY * np.cos(0.4)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (dead_imu, "the accelerometer's mean is 0.00 m/s², expected 9.81"),
        (zero("accelerometer"), "the accelerometer's mean is 0.00"),
        (scaled("accelerometer", 1 / GRAVITY), "the accelerometer's mean is 1.00"),
        (tilted_accelerometer, "disagree by 0.40 rad about where down is"),
        (scaled("accelerometer", -1.0), "about where down is"),
        (swapped, "by 3.14 rad; are the quaternion's parts in another order?"),
        (zero("quaternion"), "no orientation: its quaternion has the length 0.00"),
        (scaled("quaternion", 1.2), "no orientation: its quaternion has the length 1.20"),
        (lambda state: state.gyro.__iadd__(1.0), "orientation and gyroscope disagree"),
        (
            lambda state: state.rpy.__iadd__([0.5, 0, 0]),
            "the orientation is not that of the board's own roll, pitch and yaw, by 0.50 rad; "
            "are the quaternion's parts in another order?",
        ),
        (
            leant_and_scaled,
            "orientation and accelerometer disagree by 0.23 rad about where down is",
        ),
    ],
)
def test_a_robot_does_not_stand_up_with(wrong: Change, told: str) -> None:
    assert told in (lying(wrong) or "ready")


@settings(max_examples=20, deadline=None)
@given(
    st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(0.93, 1.07), st.floats(-0.05, 0.05)
)
def test_what_a_sensor_may_be_off_is_no_reason(roll, pitch, scale, gyro) -> None:
    """An accelerometer's offset and scale, and a gyroscope's bias."""

    def change(state: RobotState) -> None:
        state.accelerometer += GRAVITY * pitch, GRAVITY * roll, 0
        state.accelerometer *= scale
        state.gyro += gyro

    assert lying(change, seconds=0.5) is None


def test_it_takes_a_quarter_of_a_second_of_states() -> None:
    assert lying(seconds=0.2) == "no 0.25 s of states in a row yet"
    assert lying(seconds=0.3) is None


def test_a_gap_in_the_clock_begins_anew() -> None:
    body = Body(swing=0.0).well()
    body.ticks += 1000  # as a board that was started again
    body.tick()
    assert body.monitor.unready(body.now) == "no 0.25 s of states in a row yet"
    body.well(60)
    assert body.monitor.unready(body.now) is None


@pytest.mark.parametrize(
    ("factor", "went"),
    [(1e-3, "0.000995"), (0.4, "0.398"), (0.6, None), (1.8, None), (2.5, "2.49")],
)
def test_a_clock_in_another_unit_is_told(factor: float, went: str | None) -> None:
    body = Body(swing=0.0)
    body.monitor._tick_seconds *= factor
    for _ in range(200):
        body.tick()
    told = f"the board's clock went on by {went} s in 0.995 s; is link.tick_us right?"
    assert body.monitor.unready(body.now) == (told if went else None)


def test_a_clock_is_judged_after_half_a_second() -> None:
    body = Body(swing=0.0)
    body.monitor._tick_seconds *= 0.4
    for _ in range(101):
        body.tick()
    assert body.monitor.unready(body.now) == "no 0.25 s of states in a row yet"
    body.tick()
    assert "link.tick_us" in (body.monitor.unready(body.now) or "ready")


def test_what_moved_while_the_clock_was_set_anew_is_not_judged() -> None:
    body = Body(swing=0.5).well()
    body.ticks += 1037
    body.well(100)


def test_nothing_is_wrong_before_the_first_state() -> None:
    monitor = Body().monitor
    assert monitor.fault is None
    assert monitor.doubt is None
    assert monitor.attitude.gravity_error == 0
    assert monitor.unready(0) == "no orientation: its quaternion has the length 0.00"


def test_a_clock_set_anew_at_the_second_state() -> None:
    body = Body(swing=0.0)
    body.tick()
    body.ticks += 1000
    body.well()
    assert body.monitor.unready(body.now) is None


def test_a_clock_wraps() -> None:
    body = Body()
    body.ticks = 2**32 // 5 - 100
    body.well(200)
    assert body.monitor.attitude.drift > 0


def test_who_moves_begins_to_rest_anew() -> None:
    body = Body(swing=0.0).well()
    body.moving = True
    body.well(400)
    body.moving = False
    body.well(49)
    assert body.monitor.unready(body.now) == "no 0.25 s of states in a row yet"
    body.well(2)
    assert body.monitor.unready(body.now) is None


def test_both_signs_of_a_quaternion_are_one_orientation() -> None:
    body = Body()
    body.change = lambda state: state.quaternion.__imul__((-1) ** (body.ticks // 3))
    body.well(400)
    assert body.monitor.doubt is None


def test_states_that_were_lost_say_nothing() -> None:
    """Over more than two ticks a rate says too little of an angle."""
    body = Body(swing=0.5).well()
    for _ in range(40):
        body.ticks += 9
        assert body.tick() is None


# --- to the last digit -------------------------------------------------------------------------


def turn(rotation: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation vector [rad]."""
    angle = float(np.linalg.norm(rotation))
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) / angle * rotation)])


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(0)


def test_a_gyroscope_is_integrated_in_any_orientation(random) -> None:
    for _ in range(20):
        attitude, dt, wrong = AttitudeMonitor(), 0.005, random.normal(0, 1, 3)
        quaternion, rate = turn(random.normal(0, 2, 3)), random.normal(0, 2, 3)
        for tick in range(4):
            state = RobotState(quaternion=quaternion, gyro=rate + (wrong if tick == 3 else 0))
            attitude.measure(dt if tick else 0.0, state)
            # its other sign is the same orientation
            quaternion = -product(quaternion, turn(rate * dt))
            if tick < 3:
                assert attitude.drift < 1e-5
        # half of the last step was still told rightly
        assert attitude.drift == pytest.approx(np.linalg.norm(wrong) * dt / 2, rel=1e-3)


def test_a_disagreement_of_angles_fades() -> None:
    attitude = AttitudeMonitor()
    for tick in range(101):
        state = RobotState(quaternion=np.array([1.0, 0, 0, 0]))
        state.gyro[1] = 4.0 * (tick == 1)
        attitude.measure(0.005 if tick else 0.0, state)
        if tick == 2:
            assert attitude.drift == pytest.approx(0.02, rel=0.02)
    assert attitude.drift == pytest.approx(0.02 * np.exp(-0.49 / 0.25), rel=0.03)


def test_rates_are_believed_up_to_what_a_base_can_do() -> None:
    for rate, taken in ((14.0, 14.0), (-14.0, 14.0), (16.0, 15.0), (-1e9, 15.0)):
        for axis in range(3):
            attitude = AttitudeMonitor()
            state = RobotState(quaternion=np.array([1.0, 0, 0, 0]))
            state.gyro[axis] = rate
            attitude.measure(0.0, state)
            attitude.measure(0.005, state)
            assert attitude.drift == pytest.approx(taken * 0.005)
            attitude = AttitudeMonitor()
            attitude.measure(0.0, state)
            state.quaternion[:] = turn(np.eye(3)[axis] * np.copysign(taken, rate) * 0.005)
            attitude.measure(0.005, state)
            assert attitude.drift == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize(("dt", "judged"), [(0.0125, True), (0.01251, False), (0.0, False)])
def test_what_lies_too_far_apart_is_not_judged(dt: float, judged: bool) -> None:
    attitude = AttitudeMonitor()
    state = RobotState(quaternion=np.array([1.0, 0, 0, 0]), gyro=np.array([1.0, 0, 0]))
    attitude.measure(0.0, state)
    attitude.measure(dt, state)
    assert (attitude.drift > 0) is judged
    joints = JointMonitor(A1)
    joints.measure(0.0, state)
    state.dq[:] = 1.0
    joints.measure(dt, state)
    assert (joints.drift > 0) is judged


def test_roll_pitch_and_yaw_are_one_orientation(random) -> None:
    for _ in range(20):
        rpy = random.uniform(-1.4, 1.4, 3)
        about_x, about_y, about_z = (turn(axis) for axis in np.diag(rpy))
        right = product(product(about_z, about_y), about_x)
        for angle in (0.0, 0.05, 1.0):
            attitude = AttitudeMonitor()
            off = turn(np.array([0.36, 0.48, 0.8]) * max(angle, 1e-12))
            attitude.measure(0.0, RobotState(quaternion=product(right, off)))
            attitude.compare(rpy)
            assert attitude.rpy_error == pytest.approx(2 * np.sin(angle / 2), abs=1e-6)


def test_an_accelerometer_feels_what_holds_it_up_in_any_orientation(random) -> None:
    for _ in range(20):
        quaternion, wrong = turn(random.normal(0, 2, 3)), random.normal(0, 1, 3)
        up = product(product(quaternion * [1, -1, -1, -1], np.array([0, 0, 0, 1.0])), quaternion)[
            1:
        ]
        for off in (np.zeros(3), wrong):
            attitude = AttitudeMonitor()
            attitude.measure(0.01, RobotState(quaternion=quaternion))
            attitude.weigh(GRAVITY * up + off, 2.0)
            assert attitude.gravity_error == pytest.approx(np.linalg.norm(off), abs=1e-9)


@pytest.mark.parametrize("seconds", [0.25, 2.0])
def test_an_accelerometer_is_averaged(seconds: float) -> None:
    """From its first reading on; later ones count for so many seconds."""
    attitude, state = AttitudeMonitor(), RobotState(quaternion=np.array([1.0, 0, 0, 0]))

    def weigh(ticks: int, felt: float) -> None:
        for _ in range(ticks):
            for _ in range(4):
                attitude.measure(0.005, state)
            attitude.weigh(np.array([0, 0, felt]), seconds)

    attitude.measure(0.0, state)
    attitude.weigh(np.zeros(3), seconds)
    assert attitude.gravity_error == 0  # no time, no reading
    weigh(1, GRAVITY - 3)
    assert attitude.gravity_error == pytest.approx(3)
    weigh(1, GRAVITY)
    assert attitude.gravity_error == pytest.approx(1.5)
    weigh(1, GRAVITY)
    assert attitude.gravity_error == pytest.approx(1)
    weigh(1000, GRAVITY)
    assert attitude.gravity_error == pytest.approx(0, abs=1e-3)
    weigh(round(seconds / 0.02), GRAVITY - 3)
    assert attitude.gravity_error == pytest.approx(3 * (1 - np.exp(-1)), rel=0.05)
    assert attitude.gravity_text() == "the accelerometer's mean is 7.91 m/s², expected 9.81"
    attitude.measure(9.0, state)  # all that came before is older than what is averaged
    attitude.weigh(np.array([0, 0, GRAVITY - 5]), seconds)
    assert attitude.gravity_error == pytest.approx(5)


def test_angle_and_speed_are_compared_to_the_last_digit() -> None:
    """The error of a speed of one tick is that times 5 ms, and fades."""
    body = Body(swing=0.0).well(3)
    at = body.ticks

    def change(state: RobotState) -> None:
        state.q[:], state.dq[:] = A1.default_pose, 0.0
        state.dq[8] = 6.0 * (body.ticks == at + 2)

    body.change = change
    body.well(3)
    joints = body.monitor.joints
    assert joints.drift == pytest.approx(0.03, rel=0.05)
    assert joints.disagreement(joints.drift) is None
    told = "RR_calf_joint: its angle moved by -0.03 rad more than its speed tells, within 0.25 s"
    assert joints.disagreement(np.nextafter(joints.drift, 0)) == told
    body.well(50)
    assert joints.drift == pytest.approx(0.03 * np.exp(-1), rel=0.1)


def test_a_joint_is_not_faster_than_it_can_be() -> None:
    limit = 1.5 * A1.velocity_limit
    for speed, taken in ((limit - 1, limit - 1), (limit + 5, limit), (-1e6, -limit)):
        body = Body(swing=0.0, speed_error=1000)
        body.change = scaled("dq", 0.0)
        body.well(200)
        body.change = lambda state, speed=speed: state.dq.__setitem__(3, speed)
        body.well(1)
        joints = body.monitor.joints
        assert joints.drift == pytest.approx(abs(taken) * 0.005 / 2, abs=2e-3)
        sign = "-" if taken > 0 else "+"
        told = f"{A1.joint_names[3]}: its angle moved by {sign}"
        assert (joints.disagreement(0.0) or "").startswith(told)


def reached(quantity: str, **limits) -> tuple[SensorMonitor, float]:
    """A monitor of sensors that are all wrong a little, and how wrong that quantity is."""
    body = Body(swing=0.0, **limits)

    def change(state: RobotState) -> None:
        state.rpy[0] += 0.3
        state.accelerometer[0] += 1.5
        state.gyro[1] += 0.7
        state.dq[5] += 0.4

    body.change = change
    for _ in range(200):
        body.tick()
    part, name = quantity.split(".")
    return body.monitor, getattr(getattr(body.monitor, part), name)


WIDE = {"rpy_error": 4.0, "gravity_error": 20.0, "orientation_error": 9.0, "speed_error": 9.0}


@pytest.mark.parametrize(
    ("limit", "quantity"),
    [
        ("rpy_error", "attitude.rpy_error"),
        ("gravity_error", "attitude.gravity_error"),
        ("orientation_error", "attitude.drift"),
    ],
)
def test_a_limit_that_is_just_reached_is_kept(limit: str, quantity: str) -> None:
    now = 200 * PERIOD
    monitor, value = reached(quantity, **WIDE)
    assert monitor.unready(now) is None
    monitor, _ = reached(quantity, **WIDE | {limit: value})
    assert monitor.unready(now) is None
    assert monitor.fault is None
    assert monitor.doubt is None
    monitor, _ = reached(quantity, **WIDE | {limit: float(np.nextafter(value, 0))})
    assert monitor.unready(now) is not None
    assert (monitor.fault is not None) == (limit == "orientation_error")
    if limit == "rpy_error":
        assert monitor.doubt is not None


def test_in_a_walk_an_accelerometer_may_be_off_by_three_times_as_much() -> None:
    quantity = "attitude.gravity_error"
    _, value = reached(quantity, **WIDE)
    for share, doubted in ((2.9, False), (3.1, True)):
        monitor, _ = reached(quantity, **WIDE | {"gravity_error": value / share})
        assert (monitor.doubt is not None) is doubted
