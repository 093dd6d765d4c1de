import dataclasses

import numpy as np
import pytest

from rmll_hil.robot.sensors import (
    FOOT_BIAS,
    FOOT_GAIN,
    QUIET,
    FootUnits,
    Noise,
    Sensors,
    roll_pitch_yaw,
)
from rmll_hil.robot.world import load
from rmll_robots import A1

MODE = np.zeros(12, np.uint8)


@pytest.fixture
def world():
    return load(A1, friction=0.8)


def readings(world, noise: Noise, count: int, seed: int = 0):
    sensors = Sensors(world, noise, np.random.default_rng(seed))
    return [sensors.read(MODE, 2 * (k + 1)) for k in range(count)]


def test_quiet_sensors_tell_the_truth(world) -> None:
    (state,) = readings(world, QUIET, 1)
    np.testing.assert_allclose(state.q, world.q)
    np.testing.assert_allclose(state.quaternion, world.quaternion)
    np.testing.assert_allclose(state.gyro, world.gyro)
    np.testing.assert_allclose(state.rpy, 0, atol=1e-12)
    assert state.tick == 2


def test_noise_has_the_stated_strength(world) -> None:
    noise = Noise(gyro_bias=0.0)
    states = readings(world, noise, 2000)
    for name, truth, strength in [
        ("q", world.q, noise.joint_position),
        ("dq", world.dq, noise.joint_velocity),
        ("gyro", world.gyro, noise.gyro),
        ("accelerometer", world.accelerometer, noise.accelerometer),
        ("rpy", np.zeros(3), noise.attitude),
    ]:
        error = np.array([getattr(state, name) for state in states]) - truth
        assert error.std() == pytest.approx(strength, rel=0.05), name
        assert abs(error.mean()) < 0.1 * strength, name


def test_same_seed_same_readings(world) -> None:
    first, again, other = (readings(world, Noise(), 5, seed)[-1] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.q, again.q)
    np.testing.assert_array_equal(first.foot_force, again.foot_force)
    assert (first.q != other.q).all()


def test_orientation_as_quaternion_and_angles_agree() -> None:
    half = np.array([0.1, 0.2, 0.3]) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    quaternion = np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
    np.testing.assert_allclose(roll_pitch_yaw(quaternion), [0.1, 0.2, 0.3])


def foot_forces(world, newtons: list[float], noise: Noise = QUIET) -> np.ndarray:
    """Readings of four feet under a series of loads, one each 2 ms."""
    world.foot_load[:] = newtons[0]
    sensors = Sensors(world, noise, np.random.default_rng(0))
    out = []
    for k, load_newtons in enumerate(newtons):
        world.foot_load[:] = load_newtons
        out.append(sensors.read(MODE, 2 * (k + 1)).foot_force)
    return np.array(out)


def test_a_steady_load_reads_as_gain_and_bias(world) -> None:
    raw = foot_forces(world, [30.0] * 10)
    np.testing.assert_allclose(raw[-1], FOOT_GAIN * 30.0 + FOOT_BIAS, atol=0.5)
    assert raw.dtype == np.int16


def test_an_unloaded_foot_rebounds_below_its_bias_and_recovers(world) -> None:
    raw = foot_forces(world, [60.0] * 300 + [0.0] * 1000)
    assert (raw[300] < FOOT_BIAS - 5).all()
    np.testing.assert_allclose(raw[-1], FOOT_BIAS, atol=0.6)


def test_feet_drift_with_time(world) -> None:
    noise = Noise(*[0.0] * 9, foot_drift=0.5)
    ends = []
    for seed in range(40):
        world.foot_load[:] = 0
        sensors = Sensors(world, noise, np.random.default_rng(seed))
        for second in range(1, 101):
            force = sensors.read(MODE, 1000 * second).foot_force
        ends.append(force - FOOT_BIAS)
    assert np.std(ends) == pytest.approx(0.5 * np.sqrt(100), rel=0.2)


def test_an_overloaded_foot_saturates(world) -> None:
    assert (foot_forces(world, [1e6]) == 32767).all()


def test_feet_have_the_units_that_are_asked_for(world) -> None:
    units = FootUnits(gain=(1.0, 2.0, 5.0, 20.0), bias=(-500.0, 0.0, 100.0, 500.0), drift=20.0)
    world.foot_load[:] = 30.0
    sensors = Sensors(world, QUIET, np.random.default_rng(0), units)
    for seconds in (1, 2, 3):
        raw = sensors.read(MODE, 1000 * seconds).foot_force
    expected = 30.0 * np.array(units.gain) + FOOT_BIAS + np.array(units.bias) + 60.0
    np.testing.assert_allclose(raw, expected, atol=0.6)
    np.testing.assert_allclose(sensors.feet.bias, FOOT_BIAS + np.array(units.bias) + 60.0)


def test_the_feet_s_noise_grows_with_their_unit(world) -> None:
    noise = dataclasses.replace(QUIET, foot_noise_share=0.05)
    world.foot_load[:] = 30.0
    sensors = Sensors(world, noise, np.random.default_rng(0), FootUnits((2.0, 5.0, 10.0, 20.0)))
    raw = np.array([sensors.read(MODE, 2 * (k + 1)).foot_force for k in range(2000)])
    usual = A1.mass * 9.81 / 4
    np.testing.assert_allclose(raw.std(axis=0), 0.05 * usual * sensors.feet.gain, rtol=0.06)
