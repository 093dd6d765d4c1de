"""Do the motors do what they were told? If not, somebody else commands them, or the board itself.

UDP does not tell who else talks to the robot, so another commander is known by its effects: motors
in another mode, or torques that do not follow from any of our latest commands.
"""

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.state.robot_state import MotorCommand, RobotState
from rmll_robots import Robot

Array = NDArray[np.float64]

_COMMANDS = 5
"""A state may answer any of the latest ones: 25 ms for network, board and motor"""


class ActuatorMonitor:
    """Compares each state with the latest commands. Joint arrays are (12,)."""

    def __init__(self, torque_error: float, ticks: float, robot: Robot) -> None:
        """``torque_error`` [N·m] is put up with on the average of ``ticks``."""
        self._torque_error = torque_error
        self._ticks = ticks
        self._names = robot.joint_names
        joints = len(self._names)
        shape = _COMMANDS, joints
        self._upper = np.full(shape, robot.torque_limit)
        self._lower = -self._upper
        self._expected = np.zeros(shape)
        self._mode = bytes(joints)
        self._q, self._kp, self._kd = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self._sent = 0
        self._error = np.zeros(joints)
        self._strange = np.zeros(joints)
        self._doubted = False  # one of them is above 0

    def sent(self, command: MotorCommand) -> None:
        """A command is on its way."""
        row = self._sent % _COMMANDS
        self._q[row], self._kp[row], self._kd[row] = command.q, command.kp, command.kd
        self._mode = command.mode.tobytes()
        self._sent += 1

    def measure(self, state: RobotState) -> None:
        """A new state came."""
        if self._sent < _COMMANDS:
            return
        # in place and without broadcast limits, which take twice as long for so few
        expected = self._expected
        np.subtract(self._q, state.q, out=expected)
        expected *= self._kp
        expected -= self._kd * state.dq
        np.minimum(expected, self._upper, out=expected)
        np.maximum(expected, self._lower, out=expected)
        expected -= state.tau
        error = np.minimum.reduce(np.abs(expected, out=expected))
        # one reading that is far off says no more than one that is too far off
        np.minimum(error, 2 * self._torque_error, out=error)
        error -= self._error
        error *= 1 / self._ticks
        self._error += error
        if self._doubted or state.mode.tobytes() != self._mode:
            self._count(state.mode)

    def _count(self, mode: NDArray[np.uint8]) -> None:
        # one up, or one down
        strange = self._strange
        strange += 2.0 * (mode != np.frombuffer(self._mode, np.uint8)) - 1.0
        np.minimum(strange, 2 * self._ticks, out=strange)
        np.maximum(strange, 0.0, out=strange)
        self._doubted = bool(strange.any())

    def mode(self, state: RobotState) -> str | None:
        """Complains when a motor has been in another mode than it was told to."""
        if not self._doubted:
            return None
        joint = int(self._strange.argmax())
        if self._strange[joint] <= self._ticks:
            return None
        return (
            f"{self._names[joint]} is in mode {state.mode[joint]:#04x}, not in "
            f"{self._mode[joint]:#04x}: another commander, or the board protects it"
        )

    def torque(self) -> str | None:
        """Complains when a motor's torque has not been what follows from the commands."""
        joint = int(self._error.argmax())
        if self._error[joint] <= self._torque_error:
            return None
        return (
            f"{self._names[joint]} is off its commanded torque by {self._error[joint]:.0f} N·m: "
            "another commander?"
        )
