"""From torques, and sensors once they are learnt, to the two signals of the labelling function."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from rmll_gaits.label import hysteresis
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.schedule import POLICY_HZ, schedule
from rmll_onboard.control.contact_estimator import CLEAR_HEIGHT, FIRM, GRAVITY, ContactEstimator
from rmll_onboard.control.leg_force import LegForce
from rmll_onboard.settings.runtime_settings import Feet
from rmll_onboard.state.modes import Mode
from rmll_onboard.state.reports import FeetReport
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import A1

LEVEL = np.array([0.0, 0.0, -1.0])
PER_TORQUE = np.array(LegForce(A1).step(A1.stand_pose, np.tile([0.0, 0, 1], 4), LEVEL))
"""[N] on a foot for each N·m of the calf"""
WEIGHT = A1.mass * GRAVITY
USUAL = WEIGHT / 4
ALL_DOWN = np.ones(4, bool)
LOW, HIGH = np.zeros(4), np.full(4, 2 * CLEAR_HEIGHT)
"""[m] of all feet"""
TOUCH, CLEAR = Feet().touching * USUAL, Feet().clear * USUAL


@pytest.fixture
def by_torque():
    return ContactEstimator(Feet(), A1, sensors=False)


@pytest.fixture
def by_sensor():
    return ContactEstimator(Feet(), A1, sensors=True)


def state(newtons: ArrayLike, raw: ArrayLike = 0) -> RobotState:
    """A standing robot whose legs bear ``newtons`` (4,) and whose sensors read ``raw``."""
    q, tau = A1.stand_pose.copy(), np.zeros(12)
    tau[2::3] = newtons / PER_TORQUE
    reading = np.broadcast_to(np.rint(raw), 4).astype(np.int16)
    return RobotState(q=q, tau=tau, foot_force=reading)


def step(feet, state, height=LOW, down=ALL_DOWN):
    return feet.step(state, LEVEL, down, height)


def stances(gait, frequency, seconds):
    """(n, 4) which feet are down, after a moment of standing."""
    plan = schedule(load_gait(gait), frequency)
    labels = [p.label for p, n in zip(plan.phases, plan.steps, strict=True) for _ in range(n)]
    rounds = int(seconds * POLICY_HZ / len(labels))
    return (np.array([15] * 5 + labels * rounds)[:, None] >> np.arange(4) & 1).astype(bool)


def walk(feet, down, read):
    """(n, 4) the feet's bits of the label while they press as ``down`` says."""
    random = np.random.default_rng(0)
    bits, out = ALL_DOWN, []
    for stance in down:
        load = WEIGHT * stance / max(1, stance.sum())
        known = load + random.normal(0, 2.0, 4)
        height = np.where(stance, LOW, HIGH)
        bits = hysteresis(bits, *step(feet, state(known, read(load)), height, bits))
        out.append(bits)
    return np.array(out)


def wrong(bits, down):
    """Share of wrong bits; a foot may be told to be down for one step after it was lifted."""
    just_lifted = ~down & np.vstack([down[:1], down[:-1]])
    return float(((bits != down) & ~just_lifted).mean())


@pytest.mark.parametrize("gait", library_names())
@pytest.mark.parametrize("end", [0, 1])
def test_no_step_of_any_gait_is_hidden_from_the_first_one_on(gait, end):
    down = stances(gait, load_gait(gait).commands.frequency[end], 6)
    random = np.random.default_rng(end)
    gain, bias = random.uniform(0.2, 20, 4), random.uniform(-500, 500, 4)
    feet = ContactEstimator(Feet(), A1, sensors=True)
    assert wrong(walk(feet, down, lambda load: gain * load + bias), down) < 0.005
    assert feet.report().contact_by == ("sensor",) * 4
    assert wrong(walk(ContactEstimator(Feet(), A1, False), down, lambda load: 0), down) < 0.005


def test_touching_remembers_one_step_and_clear_does_not(by_torque):
    touching, clear = step(by_torque, state([USUAL, TOUCH + 1, TOUCH - 1, 0]), HIGH)
    assert touching.tolist() == [True, True, False, False]
    assert clear.tolist() == [False, False, False, True]
    touching, clear = step(by_torque, state([0, TOUCH - 1, CLEAR + 1, CLEAR - 1]), HIGH)
    assert touching.tolist() == [True, True, False, False]
    assert clear.tolist() == [True, False, False, True]
    by_torque.reset()
    assert not step(by_torque, state(0))[0].any()


def test_a_foot_in_the_air_is_felt_only_when_it_is_firm(by_torque):
    loads = [TOUCH + 1, FIRM * TOUCH + 1, TOUCH + 1, 0]
    down = np.array([False, False, True, False])
    assert step(by_torque, state(loads), HIGH, down)[0].tolist() == [False, True, True, False]


def test_a_foot_without_load_that_was_not_lifted_is_not_clear(by_torque):
    """A push unloads feet; taken for lifted, they misled the policy of a walk into falling."""
    heights = np.array([0, 0.01, CLEAR_HEIGHT, 0.03])
    step(by_torque, state(0), heights)
    touching, clear = step(by_torque, state(0), heights)
    assert not touching.any()
    assert clear.tolist() == [False, False, False, True]


def test_a_foot_that_lifts_has_risen_since_its_height_was_estimated(by_torque):
    """The estimate is a policy step old; its leg tells how far the foot has come meanwhile."""
    standing, folded = state(0), state(0)
    folded.q[1::3] += 0.1
    folded.q[2::3] -= 0.2
    step(by_torque, standing)
    assert not step(by_torque, standing, LOW)[1].any()
    assert step(by_torque, folded, LOW)[1].all()
    # it stays there: what has risen is in the estimate now
    assert not step(by_torque, folded, LOW)[1].any()
    assert not step(by_torque, standing, HIGH)[1].any()


def test_a_doubted_foot_is_named_with_its_reason_and_the_others_go_on(by_sensor):
    def read(load):
        return np.where(np.arange(4) == 0, 0, 2 * load - 20)

    down = stances("trot", 9, 6)
    assert wrong(walk(by_sensor, down, read), down) < 0.005
    reason = "reads 0 whatever the load"
    assert by_sensor.complaints == [f"foot sensor FR: {reason}; the leg's torques stand in"]
    report = by_sensor.report()
    assert report.doubts == {"FR": reason}
    assert report.contact_by == ("torque", "sensor", "sensor", "sensor")
    assert report.gain == (None, *[pytest.approx(2, rel=0.05)] * 3)


def test_a_robot_without_foot_sensors_is_not_complained_of(by_torque):
    down = stances("trot", 9, 4)
    walk(by_torque, down, lambda load: 0)
    assert by_torque.complaints == []
    assert by_torque.report() == FeetReport(("torque",) * 4, gain=(), bias=(), doubts={})


def test_a_stand_is_learnt_from_only_on_legs_that_bear_the_robot(by_sensor):
    read = lambda load: 2 * load + 50  # noqa: E731
    walk(by_sensor, stances("trot", 9, 4), read)
    held, stood = state(0.3 * USUAL, 500), state(USUAL, read(USUAL) + 300)
    for _ in range(100):
        by_sensor.rest(Mode.STANDING, held, LEVEL)  # in somebody's hands
        by_sensor.rest(Mode.DAMPING, stood, LEVEL)
        by_sensor.rest(Mode.STANDING, stood, np.full(3, np.nan))
    by_sensor.reset()
    assert by_sensor.report().bias == pytest.approx((50,) * 4, abs=4)
    for _ in range(100):
        by_sensor.rest(Mode.STANDING, stood, LEVEL)
    by_sensor.reset()
    assert by_sensor.report().bias == pytest.approx((350,) * 4, abs=4)


def test_what_was_awaited_is_told_with_all_that_is_known(by_sensor, by_torque):
    step(by_torque, state([30, 3, 0, 0]))
    assert by_torque.told([(1, True), (2, False)]) == (
        "FL on the ground (3 N by the leg's torques), RR off the ground (0 N by the leg's torques)"
    )
    step(by_sensor, state(3, 12))
    assert by_sensor.told([(1, True)]) == (
        "FL on the ground (12 raw; 3 N by the leg's torques; its sensor is not learnt yet)"
    )
    walk(by_sensor, stances("trot", 9, 4), lambda load: np.array([0, 1, 1, 1]) * (2 * load + 50))
    step(by_sensor, state(3, [0, 90, 90, 90]))
    assert by_sensor.told([(0, True), (1, False)]) == (
        "FR on the ground (0 raw; 3 N by the leg's torques; its sensor reads 0 whatever the load), "
        "FL off the ground (90 raw, 20 N by the sensor; 3 N by the leg's torques)"
    )
    assert by_sensor.told([]) == "no foot"
