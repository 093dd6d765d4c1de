"""Whether the motors do what they were told: each threshold, on its own."""

import numpy as np
import pytest

from rmll_onboard.safety.actuator_monitor import ActuatorMonitor
from rmll_onboard.state.robot_state import MODE_SERVO, MotorCommand, RobotState
from rmll_robots import A1

KNEE = 2
ERROR, TICKS = 10.0, 20.0


def command(q: float = 0.5, kp: float = 20.0, kd: float = 0.5, mode: int = MODE_SERVO):
    return MotorCommand(
        mode=np.full(12, mode, np.uint8),
        q=np.full(12, q),
        kp=np.full(12, kp),
        kd=np.full(12, kd),
    )


def state(tau: float = 0.0, **knee: float) -> RobotState:
    """All joints at 0 with ``tau``; ``knee`` differs."""
    found = RobotState(tau=np.full(12, tau), mode=np.full(12, MODE_SERVO, np.uint8))
    for name, value in knee.items():
        getattr(found, name)[KNEE] = value
    return found


@pytest.fixture
def monitor() -> ActuatorMonitor:
    """Has been told to hold 10 N·m in each joint, five times."""
    monitor = ActuatorMonitor(ERROR, TICKS, A1)
    for _ in range(5):
        monitor.sent(command())
    return monitor


def measured(monitor: ActuatorMonitor, state: RobotState, times: int) -> ActuatorMonitor:
    for _ in range(times):
        monitor.measure(state)
    return monitor


def test_nothing_is_said_before_five_commands():
    monitor = ActuatorMonitor(ERROR, TICKS, A1)
    for _ in range(4):
        monitor.sent(command())
    measured(monitor, state(tau=-100.0, mode=8), 400)
    assert monitor.torque() is None
    assert monitor.mode(state()) is None
    monitor.sent(command())
    measured(monitor, state(tau=-100.0, mode=8), 400)
    assert monitor.torque() is not None
    assert monitor.mode(state()) is not None


@pytest.mark.parametrize(("tau", "error"), [(10.0, 0.0), (4.0, 6.0), (16.0, 6.0)])
def test_the_error_is_the_distance_from_what_was_commanded(monitor, tau, error):
    measured(monitor, state(tau=tau), 1)
    np.testing.assert_allclose(monitor._error, error / TICKS)
    measured(monitor, state(tau=tau), 400)
    np.testing.assert_allclose(monitor._error, error, rtol=1e-6)


def test_speed_and_angle_count(monitor):
    """20 (0.5 - 0.1) - 0.5 * 4 = 6 N·m."""
    found = state(tau=6.0)
    found.q[:], found.dq[:] = 0.1, 4.0
    measured(monitor, found, 400)
    np.testing.assert_allclose(monitor._error, 0.0, atol=1e-9)


@pytest.mark.parametrize("side", [1, -1])
def test_a_motor_gives_no_more_than_it_can(side):
    monitor = ActuatorMonitor(ERROR, TICKS, A1)
    for _ in range(5):
        monitor.sent(command(q=side * 5.0))  # 100 N·m
    measured(monitor, state(tau=side * A1.torque_limit), 400)
    np.testing.assert_allclose(monitor._error, 0.0, atol=1e-9)


@pytest.mark.parametrize("place", range(5))
def test_any_of_the_latest_five_commands_may_be_the_one(place):
    monitor = ActuatorMonitor(ERROR, TICKS, A1)
    for number in range(5):
        monitor.sent(command(q=0.5 if number == place else -1.0))
    measured(monitor, state(tau=10.0), 50)
    np.testing.assert_allclose(monitor._error, 0.0, atol=1e-9)


def test_the_sixth_last_command_is_forgotten():
    monitor = ActuatorMonitor(ERROR, TICKS, A1)
    monitor.sent(command(q=0.5))
    for _ in range(5):
        monitor.sent(command(q=-0.5))
    measured(monitor, state(tau=10.0), 1)
    np.testing.assert_allclose(monitor._error, 20.0 / TICKS)


def test_one_reading_counts_for_twice_the_error_at_most(monitor):
    measured(monitor, state(tau=-1000.0), 1)
    np.testing.assert_allclose(monitor._error, 2 * ERROR / TICKS)


def test_a_torque_that_is_off_is_told_once_it_lasts(monitor):
    # towards 20 N·m by a twentieth a tick: above 10 after the 14th
    found = state(tau=10.0)
    found.tau[KNEE] = -50.0
    assert measured(monitor, found, 13).torque() is None
    said = measured(monitor, found, 1).torque()
    assert said == "FR_calf_joint is off its commanded torque by 10 N·m: another commander?"


def test_an_error_as_large_as_is_put_up_with_is_no_fault(monitor):
    monitor._error[:] = ERROR
    assert monitor.torque() is None
    monitor._error[KNEE] = np.nextafter(ERROR, 20)
    assert monitor.torque() is not None


def test_a_mode_that_is_another_is_told_once_it_lasts(monitor):
    found = state(tau=10.0, mode=8)
    assert measured(monitor, found, 20).mode(found) is None
    said = measured(monitor, found, 1).mode(found)
    assert said == (
        "FR_calf_joint is in mode 0x08, not in 0x0a: another commander, or the board protects it"
    )


def test_a_right_mode_takes_back_a_wrong_one_and_no_more(monitor):
    wrong, right = state(tau=10.0, mode=8), state(tau=10.0)
    measured(monitor, right, 50)  # nothing is saved up
    measured(monitor, wrong, 20)
    measured(monitor, right, 5)
    assert measured(monitor, wrong, 5).mode(wrong) is None
    assert measured(monitor, wrong, 1).mode(wrong) is not None


def test_what_lasted_long_is_forgiven_after_as_long_again(monitor):
    """The count stops at twice the patience."""
    wrong, right = state(tau=10.0, mode=8), state(tau=10.0)
    measured(monitor, wrong, 1000)
    assert measured(monitor, right, 19).mode(right) is not None
    assert measured(monitor, right, 1).mode(right) is None


def test_the_mode_is_compared_with_the_latest_command(monitor):
    monitor.sent(command(mode=0))
    braked = state(tau=10.0)
    braked.mode[:] = 0
    assert measured(monitor, braked, 100).mode(braked) is None
