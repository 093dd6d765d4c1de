"""What a foot's raw readings mean, learnt against a load that torques tell with errors."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rmll_gaits.load import library_names, load_gait
from rmll_gaits.schedule import POLICY_HZ, schedule
from rmll_onboard.control.contact_estimator import FIRM
from rmll_onboard.control.foot_calibration import LEARNING, FootCalibration

USUAL = 30.5
"""[N] of a standing A1 on one foot"""
PRESSED = 0.2 * USUAL


class Sole:
    """gain x load + bias + drift, with noise; and a leg whose torques err by some newtons."""

    def __init__(self, gain=2.0, bias=0.0, drift=0.0, noise=0.05, seed=0):
        self.gain, self.bias, self.drift = gain, bias, drift / POLICY_HZ
        self._noise = noise * USUAL * gain
        self._random = np.random.default_rng(seed)

    def read(self, load: float) -> int:
        self.bias += self.drift
        raw = self.gain * load + self.bias + self._random.normal(0, self._noise)
        return int(np.rint(raw).clip(-32768, 32767))

    def force(self, load: float) -> float:
        return load + self._random.normal(0, 5.0 if load else 2.0)


def loads(gait: str = "trot", seconds: float = 6.0, frequency: float = 9.0) -> list[float]:
    """[N] on the front right foot, each policy step of a walk."""
    plan = schedule(load_gait(gait), frequency)
    labels = [p.label for p, n in zip(plan.phases, plan.steps, strict=True) for _ in range(n)]
    rounds = int(seconds * POLICY_HZ / len(labels)) + 1
    return [4 * USUAL * (label & 1) / max(1, label.bit_count()) for label in labels * rounds]


def walk(sensor: FootCalibration, sole: Sole, path: list[float], read=None) -> list[bool]:
    """Whether the foot was felt, each step; ``read`` in place of the sole's own reading.

    As contact has it, a foot in the air is felt only if it is loaded firmly.
    """
    felt = []
    for load in path:
        raw = sole.read(load) if read is None else read(load)
        felt.append(sensor.walk(raw, sole.force(load)) > (PRESSED if load else FIRM * PRESSED))
    return felt


def share_wrong(felt: list[bool], path: list[float]) -> float:
    return float(np.mean(np.array(felt) != (np.array(path) > 0)))


@example(0.21875, 0.21875, 0.1875, 0.0, "pace", 30)
@given(
    gain=st.floats(0.2, 20), bias=st.floats(-500, 500), drift=st.floats(-20, 20),
    noise=st.floats(0, 0.05), gait=st.sampled_from(library_names()), seed=st.integers(0, 99),
)  # fmt: skip
@settings(deadline=None, max_examples=60)
def test_any_unit_is_learnt(gain, bias, drift, noise, gait, seed):
    frequency = load_gait(gait).commands.middle_frequency
    sole, path = Sole(gain, bias, drift, noise, seed), loads(gait, 8.0, frequency)
    sensor = FootCalibration(USUAL, PRESSED)
    felt = walk(sensor, sole, path)
    assert sensor.doubt is None
    assert sensor.trusted
    assert sensor.gain == pytest.approx(gain, rel=0.15)
    assert abs(sensor.bias - sole.bias) < 0.1 * USUAL * gain + 0.5  # a reading is a whole number
    assert share_wrong(felt[LEARNING:], path[LEARNING:]) < 0.01


def test_until_it_is_learnt_the_torques_are_believed():
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole(gain=7.0, bias=400)
    for step, load in enumerate(loads()):
        force = sole.force(load)
        believed = sensor.walk(sole.read(load), force)
        if step < LEARNING - 1:
            assert believed == max(force, 0.0)
            assert not sensor.trusted
    assert sensor.trusted


@pytest.mark.parametrize("drift", [-20.0, 20.0])
def test_a_long_stand_moves_the_bias_and_not_the_gain(drift):
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole(gain=1.0, drift=drift)
    walk(sensor, sole, loads())
    gain = sensor.gain
    for _ in range(60 * POLICY_HZ):
        sensor.stand(sole.read(USUAL), sole.force(USUAL))
    sensor.begin()
    assert sensor.trusted
    assert abs(sensor.bias - sole.bias) < 0.1 * USUAL
    path = loads()
    assert share_wrong(walk(sensor, sole, path), path) < 0.01
    assert sensor.gain == pytest.approx(gain, rel=0.1)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0, "reads 0 whatever the load"),
        (60, "reads 60 whatever the load"),
        (32767, "saturated, reads 32767 whatever the load"),
        (-32768, "saturated, reads -32768 whatever the load"),
    ],
)
@pytest.mark.parametrize("before", [0.0, 4.0])
def test_a_reading_that_never_changes_is_named(value, words, before):
    sensor, sole, path = FootCalibration(USUAL, PRESSED), Sole(), loads(seconds=3.0)
    walk(sensor, sole, loads(seconds=before) if before else [])
    assert sensor.trusted is bool(before)
    walk(sensor, sole, path, read=lambda load: value)
    assert not sensor.trusted
    assert sensor.doubt == words


def test_a_dead_sensor_misleads_for_a_fifth_of_a_second_at_most():
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole()
    walk(sensor, sole, loads())
    steps = 0
    while sensor.trusted:
        sensor.walk(0, sole.force(USUAL))
        steps += 1
    assert steps <= 10


def test_noise_is_named_and_not_followed():
    sensor, sole, random = FootCalibration(USUAL, PRESSED), Sole(), np.random.default_rng(0)
    path = loads()
    felt = walk(sensor, sole, path, read=lambda load: int(random.integers(18, 30)))
    assert sensor.doubt == "reads 18 to 29 whatever the load"
    assert share_wrong(felt, path) < 0.02


@pytest.mark.parametrize("noise", [0.2, 0.4])
def test_too_noisy_a_sensor_is_named(noise):
    sensor, sole, path = FootCalibration(USUAL, PRESSED), Sole(noise=noise), loads()
    felt = walk(sensor, sole, path)
    assert sensor.doubt is not None
    assert "too noisy" in sensor.doubt
    assert share_wrong(felt, path) < 0.02


def test_readings_that_fall_under_load_are_named():
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole()
    walk(sensor, sole, loads(), read=lambda load: int(200 - 2 * load))
    assert sensor.doubt is not None
    assert "whatever the load" in sensor.doubt


def test_a_sensor_that_works_again_is_believed_again():
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole()
    walk(sensor, sole, loads())
    walk(sensor, sole, loads(seconds=3.0), read=lambda load: 0)
    assert sensor.doubt
    walk(sensor, sole, loads())
    assert sensor.trusted
    assert sensor.doubt is None


@pytest.mark.parametrize("value", [-32768, 32767])
def test_a_glitch_is_passed_over(value):
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole()
    walk(sensor, sole, loads())
    gain, bias = sensor.gain, sensor.bias
    assert sensor.walk(value, 12.0) == 12.0
    assert sensor.trusted
    assert sensor.walk(sole.read(USUAL), 0.0) == pytest.approx(USUAL, abs=0.25 * USUAL)
    assert (sensor.gain, sensor.bias) == pytest.approx((gain, bias), abs=0.5)


def test_a_foot_that_never_steps_tells_nothing_and_is_not_named():
    sensor, sole = FootCalibration(USUAL, PRESSED), Sole()
    walk(sensor, sole, [USUAL] * 500)
    assert not sensor.trusted
    assert sensor.doubt is None
