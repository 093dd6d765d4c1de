"""The shipped policies on feet whose sensors have any unit, drift, or die; in lockstep."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rmll_hil.robot import sensors
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.sensors import FootUnits, Noise
from rmll_hil.runs import feet_table, lockstep, metrics
from rmll_hil.runs.feet_table import CASES, TOLERANCE, Case
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.commands.operator import FlagOperator, OperatorCommand
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.control.contact_estimator import ContactEstimator
from rmll_onboard.interface import a1_interface
from rmll_onboard.state.modes import NS, Mode, Request
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import A1

POLICIES = Path(__file__).parents[2] / "policies"
Change = Callable[[np.ndarray, float], np.ndarray]
USUAL = FootUnits()
FEET = ("FR", "FL", "RR", "RL")


class Feet(Emulator):
    """An emulator whose foot readings pass through ``change(readings, seconds)``."""

    def __init__(
        self,
        change: Change = lambda force, _: force,
        units: FootUnits = USUAL,
        noise: Noise | None = None,
    ) -> None:
        super().__init__(EmulatorSettings(seed=1), noise, A1, feet=units)
        self._change = change

    def _measure(self) -> RobotState:
        state = super()._measure()
        changed = self._change(state.foot_force.astype(float), self.now_ms / 1000)
        state.foot_force = changed.clip(-32768, 32767).astype(np.int16)
        return state


def bundle(gait: str = "trot") -> Bundle:
    return load_bundle(POLICIES / f"{gait}.onnx")


def walk(emulator: Emulator, gait: str = "trot", seconds: float = 5.0, **command) -> Outcome:
    policy = bundle(gait)
    operator = FlagOperator(policy.table.commands, **{"vx": 0.5, **command}, seconds=seconds)
    return lockstep.walk(emulator, policy, operator, lambda _: None)


def holds(outcome: Outcome, adherence: float = 0.95) -> None:
    found = metrics.summary(outcome, "trot", A1)
    assert found.fault is None
    assert found.falls == 0
    assert found.adherence > adherence


def test_a_hurried_trot_is_told_in_time_which_feet_are_in_the_air() -> None:
    # with heights that were one policy step old, every second transition came a step late: 0.92
    holds(walk(Feet(), seconds=6.0, frequency=6), 0.98)


@pytest.mark.parametrize("gain", [0.2, 0.8, 20.0])
def test_the_units_size_decides_nothing(gain, monkeypatch) -> None:
    """As tests outside this project set it."""
    monkeypatch.setattr(sensors, "FOOT_GAIN", gain)
    holds(walk(Emulator(EmulatorSettings(seed=1))), 0.96)


UNITS = {
    "low": FootUnits(0.2, -500.0),
    "high": FootUnits(20.0, 500.0),
    "rising": FootUnits(2.0, 0.0, 20.0),
    "sinking": FootUnits(0.5, 300.0, -20.0),
    "odd foot": FootUnits((2.0, 0.4, 2.0, 2.0)),
    "odder foot": FootUnits((2.0, 2.0, 20.0, 2.0)),
}


@pytest.mark.parametrize(
    ("case", "gait"),
    [*((case, "trot") for case in UNITS), ("low", "rotary_gallop"), ("rising", "pronk")],
)
def test_a_sensor_of_any_unit_is_learnt(case, gait) -> None:
    units = UNITS[case]
    outcome = walk(Feet(units=units, noise=Noise(foot_force=0.0, foot_noise_share=0.05)), gait)
    holds(outcome)
    report = outcome.report.feet
    # at 0.2 units a newton, rounding is as much noise again
    assert all("too noisy" in doubt for doubt in report.doubts.values())
    assert len(report.doubts) <= (units.gain == 0.2)
    # creep makes the emulator's feet read up to a tenth more than their gain, which varies by one
    for foot, gain in enumerate(np.broadcast_to(units.gain, 4)):
        trusted = FEET[foot] not in report.doubts
        assert report.contact_by[foot] == ("sensor" if trusted else "torque")
        assert not trusted or 0.8 * gain < report.gain[foot] < 1.35 * gain


def test_the_first_second_rests_on_no_sensor() -> None:
    """The same steps, whatever the unit."""
    began = []
    for gain in (0.2, 20.0):
        outcome = walk(Feet(units=FootUnits(gain, 500.0)), seconds=1.0)
        began.append([row.down_FR for row in outcome.log if row.mode == "walking"][:50])
    assert began[0] == began[1]


class Led:
    """Somebody with a remote: stands for a while, walks, stands again, walks again."""

    by_remote, complaint = False, None
    PLAN = ((10.0, None), (16.0, Request.WALK), (26.0, Request.STAND), (32.0, Request.WALK))

    def __init__(self) -> None:
        self._over = False

    def orders(self, now: int, mode: Mode, remote: object) -> OperatorCommand:
        request = next((r for end, r in self.PLAN if now < end * NS), Request.SIT)
        self._over = request is Request.SIT and mode is Mode.DAMPING
        if mode is Mode.DAMPING and request is not Request.SIT:
            request = Request.STAND
        return OperatorCommand(request, (0.5, 0.0, 9.0))

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return fault is not None or self._over


@pytest.mark.parametrize("units", [FootUnits(0.5, 0.0, 20.0), FootUnits(20.0, -500.0, -20.0)])
def test_led_by_a_remote_the_bias_is_followed_through_standing(units) -> None:
    emulator = Feet(units=units, noise=Noise(foot_force=0.0, foot_noise_share=0.05))
    outcome = lockstep.walk(emulator, bundle(), Led(), lambda _: None)
    holds(outcome)
    assert outcome.report.warnings == ()
    assert outcome.report.feet.contact_by == ("sensor",) * 4


def dying(feet: list[int], value: float, since: float = 0.0) -> Change:
    def change(force: np.ndarray, seconds: float) -> np.ndarray:
        if seconds >= since:
            force[feet] = value
        return force

    return change


@pytest.mark.parametrize(
    ("value", "feet", "since"),
    [
        (0, [2], 0.0),
        (60, [2], 6.0),
        (0, [0, 1, 2, 3], 6.0),
        (60, [0, 1, 2, 3], 0.0),
        (32767, [0, 1, 2, 3], 0.0),
        (-32768, [0, 1, 2, 3], 6.0),
    ],
)
def test_a_dead_sensor_is_named_and_the_walk_holds(value, feet, since) -> None:
    outcome = walk(Feet(dying(feet, value, since)), seconds=6.0)
    holds(outcome, 0.9)
    saturated = "saturated, " if abs(value) > 32000 else ""
    reason = f"{saturated}reads {value} whatever the load"
    assert outcome.report.feet.doubts == {FEET[foot]: reason for foot in feet}
    for foot in feet:
        told = f"foot sensor {FEET[foot]}: {reason}; the leg's torques stand in"
        assert told in outcome.report.warnings


@pytest.mark.parametrize("since", [0.0, 6.0], ids=["at once", "walking"])
def test_four_feet_of_noise_are_named_and_the_walk_holds(since) -> None:
    random = np.random.default_rng(0)

    def noise(force: np.ndarray, seconds: float) -> np.ndarray:
        return random.integers(18, 30, 4) if seconds >= since else force

    outcome = walk(Feet(noise), seconds=6.0)
    holds(outcome, 0.9)
    reason = "reads 18 to 29 whatever the load"
    assert outcome.report.feet.doubts == dict.fromkeys(FEET, reason)
    for foot in FEET:
        told = f"foot sensor {foot}: {reason}; the leg's torques stand in"
        assert told in outcome.report.warnings


@pytest.mark.parametrize("gait", ["trot", "pronk"])
def test_too_noisy_a_sensor_is_named_and_the_walk_holds(gait) -> None:
    outcome = walk(Feet(noise=Noise(foot_noise_share=0.25)), gait)
    holds(outcome)
    doubts = outcome.report.feet.doubts
    assert list(doubts) == list(FEET)
    assert all("too noisy" in doubt or "the leg bears" in doubt for doubt in doubts.values())


class Deaf(ContactEstimator):
    """Feels no foot that comes down."""

    def step(self, *arguments):
        _, clear = super().step(*arguments)
        return np.zeros(4, bool), clear


def test_a_stuck_gait_says_whose_contact_it_awaited(monkeypatch) -> None:
    monkeypatch.setattr(a1_interface, "ContactEstimator", Deaf)
    warnings = walk(Feet(dying([0, 3], 7)), seconds=6.0).report.warnings
    (stuck,) = {text for text in warnings if "stuck" in text}
    assert " policy steps without a transition; awaited " in stuck
    assert "on the ground" in stuck
    assert "7 raw; " in stuck
    assert "N by the leg's torques" in stuck


def test_a_feet_table_holds_what_is_learnt_against_what_is_told() -> None:
    names = {case.name: case for case in CASES}
    trot = POLICIES / "trot.onnx"
    (fine,) = feet_table.walk_all([names["gain 20, bias 500"]], [trot], 3.0, jobs=1)
    assert fine.as_expected
    assert fine.doubts == {}
    assert fine.learnt >= fine.told - TOLERANCE > 0.9
    table = feet_table.markdown([fine])
    assert table.splitlines()[2].startswith("| gain 20, bias 500 | 0.9")


def test_a_feet_table_shows_a_walk_that_is_worse(monkeypatch) -> None:
    monkeypatch.setattr(a1_interface, "ContactEstimator", FixedThresholds)
    case = Case("far off", FootUnits(0.2, 0.0))
    (worse,) = feet_table.walk_all([case], [POLICIES / "trot.onnx"], 3.0, jobs=1)
    assert not worse.as_expected
    assert "**" in feet_table.entry(worse)


class FixedThresholds(ContactEstimator):
    """Contacts as from a guess of the unit, but for those that are told it."""

    def step(self, state, gravity, down, heights):
        if self.sensors[0].trusted:
            return super().step(state, gravity, down, heights)
        force = state.foot_force
        return force > 20, force < 10


def test_an_estimate_by_a_guess_does_not_walk(monkeypatch) -> None:
    """The tests above mean something."""
    monkeypatch.setattr(a1_interface, "ContactEstimator", FixedThresholds)
    assert walk(Feet(units=FootUnits(0.5))).report.adherence < 0.5
