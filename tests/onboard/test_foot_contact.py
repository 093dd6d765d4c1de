"""Foot forces to contact signals, with sensors that have a bias, a gain and drift of their own."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from rmll_gaits.label import hysteresis
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.schedule import POLICY_HZ, schedule
from rmll_onboard.foot_calibration import WINDOW
from rmll_onboard.foot_contact import CLEAR_HEIGHT, TOUCHING_HEIGHT, FootContact
from rmll_onboard.settings import Feet
from rmll_onboard.supervisor import Mode

WEIGHT = 122.0
"""[N]"""
ALL_DOWN = np.ones(4, bool)
LOW, HIGH = np.zeros(4), np.full(4, 2 * CLEAR_HEIGHT)
"""[m] of all feet"""


@dataclass
class Soles:
    """Four sensors: gain x (load + creep) + bias + drift, with a little noise."""

    bias: np.ndarray
    gain: np.ndarray = field(default_factory=lambda: np.full(4, 2.0))
    drift: float = 0.0
    """Raw units a second"""

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(0)
        self._settled = np.full(4, WEIGHT / 4)
        self._time = 0.0

    def read(self, load) -> np.ndarray:
        self._time += 1 / POLICY_HZ
        load = np.broadcast_to(load, 4)
        self._settled += (load - self._settled) * (1 - np.exp(-0.02 / 0.2))
        felt = load + 0.1 * (load - self._settled)
        raw = self.gain * felt + self.bias + self.drift * self._time + self._random.normal(0, 1, 4)
        return np.rint(raw).astype(np.int16)


def stood_up(soles: Soles, lying: float = 25.0, settings: Feet = Feet()) -> FootContact:  # noqa: B008
    """From lying, a foot under ``lying`` newtons, to the first step of a walk."""
    feet = FootContact(settings)
    for _ in range(50):
        feet.rest(Mode.DAMPING, soles.read(lying))
    for step in range(175):
        feet.rest(Mode.STANDING_UP, soles.read(WEIGHT / 4 + 5 * np.sin(step / 8)))
    feet.rest(Mode.STANDING, soles.read(WEIGHT / 4))
    feet.reset()
    return feet


def stances(gait: str, frequency: float, seconds: float) -> np.ndarray:
    """(n, 4) which feet are down, after a moment of standing."""
    plan = schedule(load_gait(gait), frequency)
    labels = [p.label for p, n in zip(plan.phases, plan.steps, strict=True) for _ in range(n)]
    rounds = int(seconds * POLICY_HZ / len(labels))
    return (np.array([15] * 5 + labels * rounds)[:, None] >> np.arange(4) & 1).astype(bool)


def step(
    feet: FootContact, force: np.ndarray, height: np.ndarray, down: np.ndarray = ALL_DOWN
) -> tuple[np.ndarray, np.ndarray]:
    return feet.step(force, down, lambda: height)


def walk(feet: FootContact, soles: Soles, down: np.ndarray) -> np.ndarray:
    """(n, 4) the feet's bits of the label while they press as ``down`` says."""
    bits, out = np.ones(4, bool), []
    for stance in down:
        load = WEIGHT * stance / max(1, stance.sum())
        height = np.where(stance, LOW, HIGH)
        bits = hysteresis(bits, *step(feet, soles.read(load), height, bits))
        out.append(bits)
    return np.array(out)


def wrong(bits: np.ndarray, down: np.ndarray) -> float:
    """Share of wrong bits; a foot may be told to be down for one step after it was lifted."""
    just_lifted = ~down & np.vstack([down[:1], down[:-1]])
    return float(((bits != down) & ~just_lifted).mean())


@pytest.mark.parametrize("gait", library_names())
@pytest.mark.parametrize("end", [0, 1])
def test_no_sensor_hides_a_step_of_any_gait(gait, end):
    down = stances(gait, load_gait(gait).commands.frequency[end], 6)
    random = np.random.default_rng(end)
    for drift in (0.0, 3.0, -3.0):
        soles = Soles(random.uniform(-80, 60, 4), random.uniform(1.5, 3, 4), drift)
        assert wrong(walk(stood_up(soles), soles, down), down) < 0.005


def test_the_thresholds_of_a_fixed_bias_would_not_do():
    """The tests above mean something: without calibration a fifth of the bits is wrong."""
    soles = Soles(np.array([60.0, -60, 40, -30]), drift=3.0)
    down = stances("trot", 9, 12)
    bits = np.array([soles.read(WEIGHT / 2 * stance) > 20 for stance in down])
    assert wrong(bits, down) > 0.2


@pytest.mark.parametrize("gain", [0.8, 5.0])
def test_a_first_guess_that_is_far_off_is_mended_within_a_window(gain):
    soles = Soles(np.array([-20.0, 10, 30, 0]), np.full(4, gain))
    feet, down = stood_up(soles), stances("trot", 9, 8)
    bits = walk(feet, soles, down)
    assert wrong(bits[WINDOW + 10 :], down[WINDOW + 10 :]) < 0.005
    np.testing.assert_allclose(feet.report()["unloaded"], soles.bias, atol=0.3 * gain * 30)


def test_feet_in_the_air_while_lying_tell_the_load_of_standing_at_once():
    soles = Soles(np.array([-20.0, 10, 30, 0]), np.full(4, 4.0))
    measured = stood_up(soles, lying=0.0).report()
    np.testing.assert_allclose(measured["unloaded"], soles.bias, atol=15)
    np.testing.assert_allclose(measured["load"], 122, atol=15)
    soles = Soles(np.zeros(4))
    assert stood_up(soles, lying=25.0).report()["load"] == [60.0] * 4


def test_touching_remembers_one_step_and_clear_does_not():
    feet = FootContact(Feet(load=100, touching=0.2, clear=0.1))
    touching, clear = step(feet, np.array([100, 21, 15, -30], np.int16), HIGH)
    assert touching.tolist() == [True, True, False, False]
    assert clear.tolist() == [False, False, False, True]
    touching, clear = step(feet, np.array([0, 20, 10, 9], np.int16), HIGH)
    assert touching.tolist() == [True, True, False, False]
    assert clear.tolist() == [True, False, False, True]
    feet.reset()
    assert not step(feet, np.zeros(4, np.int16), LOW)[0].any()


def test_a_foot_without_load_that_was_not_lifted_is_not_clear():
    """A push unloads feet; taken for lifted, they misled the policy of a walk into falling."""
    feet = FootContact(Feet(load=100))
    for _ in range(2):
        touching, clear = step(feet, np.zeros(4, np.int16), np.array([0, 0.01, CLEAR_HEIGHT, 0.03]))
    assert not touching.any()
    assert clear.tolist() == [False, False, False, True]


def test_heights_are_asked_for_only_when_a_label_hangs_on_them():
    """They cost a run of the network, in a tick that the robot waits for."""
    random, settings = np.random.default_rng(0), Feet(load=100)
    asked, feet = 0, FootContact(settings)
    bits = expected = ALL_DOWN
    before = ~ALL_DOWN
    for _ in range(1000):
        force, height = random.integers(-20, 60, 4), random.uniform(0, 2 * CLEAR_HEIGHT, 4)

        def look(height: np.ndarray = height) -> np.ndarray:
            nonlocal asked
            asked += 1
            return height

        bits = hysteresis(bits, *feet.step(force.astype(np.int16), bits, look))
        measured = feet.calibration
        share = (force - measured.unloaded) / measured.load
        pressed, clear = share > settings.touching, share < settings.clear
        expected = hysteresis(expected, pressed | before, clear & (height > CLEAR_HEIGHT))
        before = pressed
        assert (bits == expected).all()
    assert 0 < asked < 1000


def test_standing_still_for_long_does_not_pass_for_a_foot_in_the_air():
    soles = Soles(np.array([-1.0, -2, -21, -5]))
    feet = stood_up(soles)
    assert walk(feet, soles, np.ones((10 * POLICY_HZ, 4), bool)).all()
    assert feet.report()["dead"] == []


def test_a_glitch_is_not_taken_for_a_foot_in_the_air():
    soles = Soles(np.full(4, -5.0))
    feet, down = stood_up(soles), stances("trot", 9, 4)
    walk(feet, soles, down)
    before = np.array(feet.report()["unloaded"])
    step(feet, np.full(4, -32768, np.int16), LOW)
    step(feet, np.full(4, 32767, np.int16), LOW)
    walk(feet, soles, down[:10])
    np.testing.assert_allclose(feet.report()["unloaded"], before, atol=5)


@pytest.mark.parametrize("value", [0, -32768, 32767])
def test_a_foot_that_never_moved_is_dead_before_the_first_step(value):
    soles = Soles(np.zeros(4))
    read = soles.read
    soles.read = lambda load: np.where(np.arange(4) == 2, value, read(load)).astype(np.int16)
    feet = stood_up(soles)
    assert feet.report()["dead"] == ["RR"]
    height = np.array([0, 0, TOUCHING_HEIGHT / 2, 0])
    assert step(feet, soles.read(30), height)[0][2]
    step(feet, soles.read(30), height + CLEAR_HEIGHT)
    touching, clear = step(feet, soles.read(30), height + CLEAR_HEIGHT)
    assert (touching[2], clear[2]) == (False, True)


def test_a_foot_that_dies_while_walking_is_found_and_one_that_revives_too():
    soles = Soles(np.zeros(4))
    feet, down = stood_up(soles), stances("trot", 9, 3)
    read = soles.read
    walk(feet, soles, down)
    assert feet.report()["dead"] == []
    noise = np.random.default_rng(0)
    hiss = lambda load: np.where(np.arange(4) == 1, noise.normal(0, 1), read(load))  # noqa: E731
    soles.read = lambda load: np.rint(hiss(load)).astype(np.int16)
    walk(feet, soles, down)
    assert feet.report()["dead"] == ["FL"]
    soles.read = read
    walk(feet, soles, down)
    assert feet.report()["dead"] == []


def test_a_reading_that_stops_is_dead_after_a_third_of_a_second_until_it_changes():
    soles = Soles(np.zeros(4))
    feet, down = stood_up(soles), stances("trot", 9, 3)
    read = soles.read
    walk(feet, soles, down)
    soles.read = lambda load: np.where(np.arange(4) == 3, 7, read(load)).astype(np.int16)
    walk(feet, soles, down[:15])
    assert feet.report()["dead"] == []
    walk(feet, soles, down[:1])
    assert feet.report()["dead"] == ["RL"]
    soles.read = read
    walk(feet, soles, down[:1])
    assert feet.report()["dead"] == []


def test_four_dead_feet_are_four_dead_feet():
    soles = Soles(np.zeros(4))
    soles.read = lambda load: np.zeros(4, np.int16)
    assert stood_up(soles).report()["dead"] == ["FR", "FL", "RR", "RL"]
