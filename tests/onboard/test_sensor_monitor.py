"""Which sensors are believed, and how soon one that is wrong is told."""

from collections.abc import Callable
from functools import cache
from math import pi
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmll_onboard.a1_wire import RobotState
from rmll_onboard.sensor_monitor import GRAVITY, SensorMonitor, Streams
from rmll_onboard.settings import Safety
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
    "fields", [("quaternion", "gyro", "accelerometer", "rpy"), ("q", "dq"), ("gyro",), ("tau",)]
)
def test_what_is_frozen_together_is_told_by_name(fields) -> None:
    body = Body(orientation_error=1000, speed_error=1000).well()
    body.frozen(*fields)
    assert "the same values for 1" in body.until_fault(40)


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
    assert f"{A1.joint_names[4]} has read the same for 5" in (body.monitor.joints.still(500) or "")
    body.moving = False
    body.well(8)
    assert body.monitor.joints.still(500) is None


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
    assert lying(streams=Streams(False, False)) is None


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
        (lambda state: state.rpy.__iadd__(0.5), "roll, pitch and yaw"),
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


@pytest.mark.parametrize("factor", [1e-3, 0.4, 2.5])
def test_a_clock_in_another_unit_is_told(factor: float) -> None:
    body = Body(swing=0.0)
    body.monitor._tick_seconds *= factor
    body.change = lambda state: None
    for _ in range(200):
        body.tick()
    told = body.monitor.unready(body.now) or ""
    assert "the board's clock went on by" in told
    assert "is link.tick_us right?" in told


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
