"""Each check, and how long it is patient."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmll_gaits.load import load_gait
from rmll_gaits.table import ADVANCE
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.interface.a1_interface import A1Interface
from rmll_onboard.safety.faults import Fault
from rmll_onboard.safety.gait_monitor import GaitMonitor
from rmll_onboard.safety.guard import ActionGuard, Guard, SafetyInput
from rmll_onboard.settings.runtime_settings import LinkSettings, Safety
from rmll_onboard.state.attitude import projected_gravity, roll_pitch
from rmll_onboard.state.robot_state import MODE_SERVO, MotorCommand, RobotState
from rmll_robots import A1

BOARD = A1BoardPackets()
PERIOD = 5_000_000
FR_CALF = 2


class Bench:
    """A robot that walks, obeys, and shivers as real ones do; a tick each :meth:`tick`."""

    def __init__(self, **safety):
        self.interface = A1Interface(LinkSettings(), A1)
        # what is set here at once, no robot does at once
        calm = {"orientation_error": 1000, "speed_error": 1000}
        self.guard = Guard(A1, Safety(**calm | safety), self.interface, PERIOD)
        self.state = RobotState(q=A1.default_pose.copy(), quaternion=np.array([1.0, 0, 0, 0]))
        self.command = MotorCommand(
            mode=np.full(12, MODE_SERVO, np.uint8),
            q=A1.default_pose.copy(),
            kp=np.full(12, A1.kp),
            kd=np.full(12, A1.kd),
        )
        self.random = np.random.default_rng(0)
        self.imu_shivers, self.joints_shiver, self.speeds_shiver = 1.0, np.full(12, 1e-6), 0.0
        self.now = 0
        self.walking = self.moving = self.obedient = True
        self.datagrams = lambda good: [good]

    def tick(self, period=PERIOD):
        self.now += period
        state = self.state
        state.tick = self.now // 1_000_000
        if self.imu_shivers:
            state.accelerometer[:] = -9.81 * projected_gravity(state.quaternion)
            state.accelerometer += self.random.normal(0, 0.1, 3)
            state.rpy[1] = 2 * np.arctan2(state.quaternion[2], state.quaternion[0])
        state.gyro += self.imu_shivers * self.random.normal(0, 1e-4, 3)
        state.quaternion[3] += self.imu_shivers * self.random.normal(0, 1e-6)
        state.q += self.joints_shiver * self.random.normal(0, 1, 12)
        state.dq += self.speeds_shiver * self.random.normal(0, 1, 12)
        if self.obedient:
            state.mode[:] = self.command.mode
            state.tau[:] = self.command.kp * (self.command.q - state.q)
            state.tau -= self.command.kd * state.dq
        datagrams = self.datagrams(BOARD.encode_state(state))
        fresh = self.interface.take(self.now, datagrams, resting=False)
        seen = self.interface.state
        gravity = projected_gravity(seen.quaternion)
        complaint = self.guard.complaint(
            SafetyInput(self.now, seen, fresh, gravity, self.moving, self.walking)
        )
        self.guard.actuators.sent(self.command)
        return complaint and complaint.detail

    def ticks_until_complaint(self, most=400):
        """How many ticks, and what was said."""
        for count in range(1, most + 1):
            if complaint := self.tick():
                return count, complaint
        return None, None

    def well(self, ticks=50):
        for _ in range(ticks):
            assert self.tick() is None
        return self


def flip(bench):
    bench.state.quaternion[:] = [0, 1, 0, 0]


def no_rotation(bench):
    bench.imu_shivers = 0.0
    bench.state.quaternion[:] = 0


def pitch_up(bench):
    bench.state.quaternion[:] = [np.cos(0.55), 0, np.sin(0.55), 0]


def far_joint(bench):
    bench.state.q[FR_CALF] = -0.5


def near_joint(bench):
    bench.state.q[FR_CALF] = -0.85


def quick_joint(bench):
    bench.state.dq[FR_CALF] = 21.5


def absurd_speed(bench):
    bench.state.dq[FR_CALF] = 3e38


def strong_motors(bench):
    bench.obedient = False
    bench.state.dq[:], bench.state.tau[:] = 10.0, 9.0
    bench.command.kp[:], bench.command.kd[:] = 0.0, -0.9  # told to


def hot_joint(bench):
    bench.state.temperature[FR_CALF] = 58


def silence(bench):
    bench.datagrams = lambda good: []


def freeze(bench):
    last = BOARD.encode_state(bench.state)
    bench.datagrams = lambda good: [last]


def values_freeze(bench):
    bench.imu_shivers, bench.joints_shiver = 0.0, np.zeros(12)


def encoder_freeze(bench):
    bench.joints_shiver[FR_CALF] = 0


def corruption(bench):
    bench.datagrams = lambda good: [good if bench.now // PERIOD % 4 == 0 else good[:-1]]


def other_mode(bench):
    bench.obedient = False
    bench.state.mode[FR_CALF] = 8


def other_torque(bench):
    bench.obedient = False
    bench.state.tau[FR_CALF] = 15


def late(bench):
    bench.tick(period=22 * PERIOD)


FAULTS = {
    flip: ("tilted: roll 3.14", 1),
    no_rotation: ("no orientation: its quaternion is [0.0, 0.0, 0.0, 0.0]", 1),
    pitch_up: ("pitch 1.10", 1),
    far_joint: ("FR_calf_joint at -0.50 rad, 0.42 rad past its limit", 1),
    near_joint: ("FR_calf_joint at -0.85 rad, its limit is -0.92 rad", 6),
    quick_joint: ("FR_calf_joint turns at 21.5 rad/s", 6),
    absurd_speed: ("speeds that no joint can have", 1),
    strong_motors: ("the motors take 1080 W", 6),
    hot_joint: ("FR_calf_joint is at 58 °C", 6),
    silence: ("no state from the robot for 55 ms (refused: none)", 11),
    freeze: ("no state from the robot for 55 ms (refused: 11 repeated)", 11),
    values_freeze: ("have not changed for 105 ms", 21),
    encoder_freeze: ("FR_calf_joint has read the same for 5", None),
    corruption: ("of the ticks bring broken datagrams only", None),
    other_mode: ("FR_calf_joint is in mode 0x08, not in 0x0a", 21),
    other_torque: ("FR_calf_joint is off its commanded torque", None),
    late: ("deadlines missed: 21 ticks late", 1),
}


@pytest.mark.parametrize("break_it", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_is_noticed_in_time(break_it):
    words, ticks = FAULTS[break_it]
    bench = Bench().well()
    break_it(bench)
    count, complaint = (1, bench.tick()) if break_it is late else bench.ticks_until_complaint()
    assert words in (complaint or "nothing")
    assert ticks in (None, count)
    assert count < 130


@pytest.mark.parametrize(
    "brief", [near_joint, quick_joint, strong_motors, hot_joint], ids=lambda fault: fault.__name__
)
def test_what_is_brief_is_put_up_with(brief):
    bench = Bench().well()
    bench.speeds_shiver = 1e-6
    healthy = bench.command
    for _ in range(20):
        brief(bench)
        bench.well(ticks=5)
        bench.state.q[:], bench.state.dq[:] = A1.default_pose, 0
        bench.state.temperature[:], bench.obedient = 30, True
        bench.command = MotorCommand(healthy.mode, A1.default_pose, kp=np.full(12, A1.kp))
        bench.well(ticks=10)


def test_a_bounding_robot_is_healthy():
    """Pitch, speed, power and heat near what is allowed, and 25 ms between command and effect."""
    bench = Bench()
    told = []
    for tick in range(400):
        swing = np.sin(2 * np.pi * tick / 60)
        bench.state.quaternion[:] = [np.cos(0.2 * swing), 0, np.sin(0.2 * swing), 0]
        bench.state.q[:] = A1.default_pose + 0.2 * swing
        bench.state.dq[:] = 5 * swing
        bench.state.dq[FR_CALF] = 20.9 * swing
        bench.state.temperature[:] = 57
        bench.command.q[:] = A1.default_pose - 0.2 * swing
        told.append(bench.command.q.copy())
        bench.obedient = False
        bench.state.mode[:] = MODE_SERVO
        effective = told[max(0, tick - 4)]
        bench.state.tau[:] = A1.kp * (effective - bench.state.q) - A1.kd * bench.state.dq
        assert bench.tick() is None
    assert len(bench.guard.warnings) == 12  # once a joint
    assert bench.guard.warnings[0] == "FR_hip_joint reached 57 °C"


def test_a_joint_at_its_limit_is_a_fault_only_while_walking():
    bench = Bench()
    bench.walking = False
    near_joint(bench)
    bench.well(400)


def test_time_lost_is_made_up_for():
    bench = Bench().well()
    for _ in range(100):
        assert bench.tick(period=3 * PERIOD) is None  # two ticks left out
        bench.well(ticks=8)
    complaints = [bench.tick(period=3 * PERIOD) for _ in range(12)]
    assert "deadlines missed" in complaints[-1]


def test_a_damped_robot_has_no_deadlines():
    bench = Bench()
    bench.moving = bench.walking = False
    bench.well()
    assert bench.tick(period=100 * PERIOD) is None
    bench.moving = True
    bench.well()


def test_one_strange_torque_is_no_other_commander():
    bench = Bench().well()
    bench.obedient = False
    bench.state.tau[FR_CALF] = 120
    bench.well(ticks=3)
    bench.obedient = True
    bench.well()


def no_more_than(value):
    """The largest limit that ``value`` exceeds."""
    return float(np.nextafter(value, -np.inf))


def told(change, ticks=1, **safety):
    """What a new bench says at the last of so many ticks with a change."""
    bench = Bench(patience=0, **safety)
    bench.joints_shiver[:] = 0
    change(bench)
    for _ in range(ticks - 1):
        assert bench.tick() is None
    return bench.tick()


def test_a_limit_that_is_just_reached_is_kept():
    """Each as it is in a packet, so that the numbers are the same to the last bit."""
    bench = Bench(torque_error=100)
    pitch_up(bench)
    bench.tick()
    pitch = abs(roll_pitch(projected_gravity(bench.interface.state.quaternion))[1])
    assert told(pitch_up, pitch_limit=pitch) is None
    assert told(pitch_up, pitch_limit=no_more_than(pitch)).startswith("tilted")

    def roll_over(bench):
        bench.state.quaternion[:] = [np.cos(0.55), np.sin(0.55), 0, 0]

    bench = Bench()
    roll_over(bench)
    bench.tick()
    roll = abs(roll_pitch(projected_gravity(bench.interface.state.quaternion))[0])
    assert told(roll_over, roll_limit=roll) is None
    assert told(roll_over, roll_limit=no_more_than(roll)).startswith("tilted")

    def at_limit(bench, walking):
        near_joint(bench)
        bench.walking = walking

    bench = Bench()
    bench.joints_shiver[:] = 0
    at_limit(bench, False)
    bench.tick()
    middle, reach = (A1.joint_upper + A1.joint_lower) / 2, (A1.joint_upper - A1.joint_lower) / 2
    past = float((np.abs(bench.interface.state.q - middle) - reach)[FR_CALF])
    far = lambda bench: at_limit(bench, False)  # noqa: E731
    near = lambda bench: at_limit(bench, True)  # noqa: E731
    assert told(far, joint_beyond=past) is None
    assert told(far, joint_beyond=no_more_than(past)).endswith("0.07 rad past its limit")
    assert told(near, joint_margin=-past) is None
    assert told(near, joint_margin=-no_more_than(past)).endswith("its limit is -0.92 rad")


def test_a_margin_is_kept_within_the_limit():
    def close(bench):
        bench.state.q[FR_CALF] = -0.95

    assert told(close, joint_margin=0.02) is None
    assert told(close, joint_margin=0.05).endswith("its limit is -0.92 rad")


def test_speed_power_and_heat_that_are_just_reached():
    def speed(bench, value):
        bench.state.dq[FR_CALF] = value

    assert told(lambda bench: speed(bench, 20), joint_speed=20) is None
    assert told(lambda bench: speed(bench, 20.1), joint_speed=20) is not None
    # the margin is judged with patience, what cannot be is not
    assert Bench().tick() is None
    for value, words in ((100, None), (100.1, "joint speeds that no joint can have")):
        bench = Bench(power=5000, torque_error=100)
        bench.joints_shiver[:] = 0
        speed(bench, value)
        assert bench.tick() == words

    def power(bench):
        bench.obedient = False
        bench.state.dq[FR_CALF], bench.state.tau[FR_CALF] = 20, 10

    assert told(power, power=200) is None
    assert told(power, power=no_more_than(200)) == "the motors take 200 W"

    def heat(bench, value):
        bench.state.temperature[FR_CALF] = value

    assert told(lambda bench: heat(bench, 57)) is None
    assert told(lambda bench: heat(bench, 58)) == "FR_calf_joint is at 58 °C"


def test_a_warm_motor_is_told_once():
    bench = Bench()
    bench.state.temperature[FR_CALF] = 49
    bench.well(10)
    assert bench.guard.warnings == []
    bench.state.temperature[FR_CALF] = 50
    bench.well(10)
    assert bench.guard.warnings == ["FR_calf_joint reached 50 °C"]
    bench.guard.warnings.clear()
    bench.well(10)
    assert bench.guard.warnings == []


def test_warnings_are_kept_once_and_no_more_than_a_hundred():
    guard = Bench().guard
    for number in range(150):
        guard.warn(str(number))
        guard.warn("0")
    assert guard.warnings == [str(number) for number in range(100)]


def test_ages_are_exact():
    """Ten nanoseconds past the limit."""
    bench = Bench().well()
    silence(bench)
    assert bench.tick(period=50_000_000) is None
    assert bench.tick(period=10) == "no state from the robot for 50 ms (refused: none)"
    bench = Bench(stale_ms=1000)
    values_freeze(bench)
    bench.tick()
    assert bench.tick(period=100_000_000) is None
    bench = Bench(stale_ms=1000)
    values_freeze(bench)
    bench.tick()
    assert bench.tick(period=100_000_010).endswith("have not changed for 100 ms")
    bench = Bench(joint_still_ms=500 - 1e-4).well()
    encoder_freeze(bench)
    assert 100 <= bench.ticks_until_complaint()[0] <= 108
    bench = Bench(actuator_ms=100 - 5e-5).well()
    other_mode(bench)
    assert bench.ticks_until_complaint()[0] == 20


def test_what_was_refused_is_told():
    bench = Bench().well()
    bench.datagrams = lambda good: [good[:-1]]
    bench.tick()
    bench.datagrams = lambda good: [good[:200] + bytes(1) + good[201:-4] + bytes(4)]
    _, complaint = bench.ticks_until_complaint()
    assert complaint == "no state from the robot for 55 ms (refused: 1 length, 10 checksum)"


def test_the_share_of_broken_ticks_is_averaged_over_a_hundred():
    share, ticks = 0.0, 0
    while share <= 0.5:
        share += (1 - share) / 100
        ticks += 1
    bench = Bench(stale_ms=1000)
    bench.datagrams = lambda good: [good[:-1]]
    assert bench.ticks_until_complaint() == (ticks, "50% of the ticks bring broken datagrams only")
    share = 0.0
    for _ in range(10):
        share += (1 - share) / 100
    bench = Bench(stale_ms=1000, broken_share=share)
    bench.datagrams = lambda good: [good[:-1]]
    assert bench.ticks_until_complaint()[0] == 11


def test_ticks_left_out_are_counted_one_by_one():
    bench = Bench(stale_ms=1000)
    bench.tick()
    for _ in range(20):
        assert bench.tick(period=2 * PERIOD) is None
    assert bench.tick(period=2 * PERIOD) == "deadlines missed: 21 ticks late"
    bench = Bench(stale_ms=1000)
    bench.moving = False
    bench.tick()
    bench.moving = True
    assert bench.tick(period=21 * PERIOD) is None
    assert bench.tick(period=2 * PERIOD) == "deadlines missed: 21 ticks late"


def test_patience_counts_from_the_first_tick_and_back_by_one():
    bench = Bench()
    quick_joint(bench)
    assert bench.ticks_until_complaint()[0] == 6
    bench = Bench()
    quick_joint(bench)
    bench.well(4)
    bench.state.dq[:] = 0
    bench.well(1)
    quick_joint(bench)
    assert bench.ticks_until_complaint()[0] == 3


def test_a_sensor_that_a_walk_can_do_without_is_told_once():
    bench = Bench()
    bench.moving = bench.walking = False
    bench.state.rpy[0] = 0.5
    bench.well(10)
    assert bench.guard.warnings == []
    bench.moving = bench.walking = True
    bench.well(10)
    (told,) = bench.guard.warnings
    assert told.startswith("the orientation is not that of the board's own roll, pitch and yaw")
    bench.state.rpy[0] = 0.7  # another text of the same sensor
    bench.well(10)
    assert bench.guard.warnings == [told]
    bench.imu_shivers = 0.0
    bench.state.rpy[:], bench.state.accelerometer[:] = 0, [0, 0, -9.81]
    bench.well(200)
    assert len(bench.guard.warnings) == 2
    assert "accelerometer" in bench.guard.warnings[1]


def test_sensors_are_told_whether_the_robot_moves():
    bench = Bench().well(100)
    assert bench.guard.sensors.unready(bench.now) == "no 0.25 s of states in a row yet"
    bench.moving = bench.walking = False
    bench.well(100)
    assert bench.guard.sensors.unready(bench.now) is None


def test_sensors_may_disagree_for_as_long_as_a_joint_may_be_hot():
    """Not at once, for one wrong reading is no blind robot."""

    def ticks(**safety):
        bench = Bench(orientation_error=0.1, **safety).well()
        bench.state.gyro[2] = 5.0
        count, told = bench.ticks_until_complaint()
        assert told.startswith("orientation and gyroscope disagree by ")
        return count

    assert ticks(patience=7) == ticks(patience=0) + 7


@pytest.mark.parametrize(("limit", "least"), [(200, 40), (500, 100)])
def test_a_joint_that_reads_the_same_in_a_walk_is_told_without_patience(limit, least):
    """It is looked at every 50 ms, in one of four ticks."""
    for patience in (0, 50):
        bench = Bench(joint_still_ms=limit, patience=patience).well()
        encoder_freeze(bench)
        count, told = bench.ticks_until_complaint()
        assert told.startswith("FR_calf_joint has read the same for ")
        assert least < count <= least + 24
    bench = Bench(joint_still_ms=limit)
    bench.walking = False
    encoder_freeze(bench)
    bench.well(200)


def test_what_was_measured_is_judged_once():
    bench = Bench()
    quick_joint(bench)
    bench.well(5)
    silence(bench)
    bench.well(5)


numbers = st.floats(width=32, allow_nan=False, allow_infinity=False)


@pytest.mark.fuzz
@settings(deadline=None, max_examples=50)
@given(st.lists(numbers, min_size=12, max_size=12), st.lists(numbers, min_size=12, max_size=12))
def test_any_measurement_is_judged(q, dq):
    """Whatever a whole datagram may say, there is an answer and no exception."""
    bench = Bench().well(ticks=6)
    bench.obedient = False
    bench.state.q[:], bench.state.dq[:] = q, dq
    complaint = bench.tick()
    past = np.maximum(np.array(q) - A1.joint_upper, A1.joint_lower - np.array(q)).max()
    if past > 0.2 or max(map(abs, dq)) > 101:
        assert complaint


def test_the_policy_must_answer_within_its_range():
    guard, target = ActionGuard(clip=8.0, patience=2), np.zeros(12)
    fine, wild = np.full(12, 16, np.float32), np.full(12, -16.1, np.float32)
    for action in (wild, wild):
        assert guard.complaint(action, target) is None
    for action in (fine, wild, wild, fine, wild, wild):
        assert guard.complaint(action, target) is None
    assert guard.complaint(wild, target) == (
        Fault.POLICY_OUT_OF_RANGE,
        "the policy's action is 16.1, its range 8",
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_not_sent(bad):
    fine, target = np.zeros(12, np.float32), np.zeros(12)
    wrong, nowhere = fine.copy(), target.copy()
    wrong[3] = nowhere[5] = bad
    told = Fault.POLICY_NOT_FINITE, "the policy's action is no finite number"
    assert ActionGuard(8.0, 2).complaint(wrong, nowhere) == told
    told = Fault.POLICY_NOT_FINITE, "the policy's joint targets are not finite"
    assert ActionGuard(8.0, 2).complaint(fine, nowhere) == told


def test_a_gait_is_stuck_far_beyond_its_longest_dwell(bundle):
    monitor = GaitMonitor(bundle.table, factor=10)
    assert not monitor.stuck(phi=90, frequency=9)
    assert monitor.stuck(phi=91, frequency=9)


def test_what_a_gait_awaits_is_what_its_nearest_edge_wants():
    monitor = GaitMonitor(load_gait("trot"), factor=10)
    table = load_gait("trot")
    state = table.start
    edges = [label for label in range(16) if table.effect[state, label] == ADVANCE]
    assert all(monitor.awaited(state, label) == [] for label in edges)
    (edge,) = edges
    for foot in range(4):
        assert monitor.awaited(state, edge ^ 1 << foot) == [(foot, bool(edge >> foot & 1))]
    assert [foot for foot, _ in monitor.awaited(state, edge ^ 15)] == [0, 1, 2, 3]
