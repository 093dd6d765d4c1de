"""Joint angles against joint speeds, and joints that always read the same."""

from math import exp

import numpy as np

from rmll_onboard.safety.attitude_monitor import LONGEST, MEMORY
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import Robot

_FASTEST = 1.5
"""Times the robot's own limit of joint speeds; a faster one is taken for that, so that a single
wrong reading stays below the limit and ends no walk"""


class JointMonitor:
    """Angles against speeds, and joints that always read the same. Arrays are (12,)."""

    def __init__(self, robot: Robot) -> None:
        joints = len(robot.joint_names)
        self._names = robot.joint_names
        self._fastest = _FASTEST * robot.velocity_limit
        # how far angles and integrated speeds are apart [rad]; then angles and speeds, newest
        # and before, which change places at every state; one product adds all of it up
        self._rows = np.zeros((5, joints))
        self._weights = np.zeros((2, 5))
        self._dt = 0.0
        self._newest = 0
        self._sum = np.zeros(joints)
        self._apart = self._rows[0]
        self.still_ms = 0.0
        """[ms] that one joint of a walking robot has read the same"""
        self._seen = np.zeros((2, joints))
        self._moved = np.zeros(joints)  # [ns] when each joint last read something else

    @property
    def drift(self) -> float:
        """[rad] that an angle and the integral of its speed are apart, at the worst joint"""
        return float(np.abs(self._apart).max())

    def measure(self, dt: float, state: RobotState) -> None:
        """``dt`` [s] since the state before."""
        newest = self._newest = 1 - self._newest
        rows = self._rows
        rows[1 + newest], rows[3 + newest] = state.q, state.dq
        speeds = rows[3 + newest]
        if speeds @ speeds > self._fastest**2:
            speeds.clip(-self._fastest, self._fastest, out=speeds)
        if not 0 < dt <= LONGEST:
            return
        if dt != self._dt:
            self._weigh(dt)
        self._weights[newest].dot(rows, out=self._sum)
        self._apart[:] = self._sum

    def disagreement(self, limit: float) -> str | None:
        """Of an angle and its speed, by more than ``limit`` [rad]."""
        apart = self._apart
        # most of the time not even all together are that far apart
        if apart @ apart <= limit * limit or self.drift <= limit:
            return None
        joint = int(np.abs(apart).argmax())
        return (
            f"{self._names[joint]}: its angle moved by {apart[joint]:+.2f} rad more than its speed "
            f"tells, within {MEMORY:g} s"
        )

    def watch(self, now: int, state: RobotState, walking: bool) -> None:
        """Look now and then whether a walking robot's joints read what they read before."""
        if not walking:
            self.still_ms = 0.0
            self._moved[:] = now
        else:
            q, dq = self._seen
            np.copyto(self._moved, now, where=(state.q != q) | (state.dq != dq))
            q[:], dq[:] = state.q, state.dq
            moved = self._moved
            self.still_ms = (now - float(moved[moved.argmin()])) / 1e6

    def still(self, limit_ms: float) -> str | None:
        """A joint of a walking robot that has read the same for longer."""
        if self.still_ms <= limit_ms:
            return None
        return f"{self._names[self._moved.argmin()]} has read the same for {self.still_ms:.0f} ms"

    def _weigh(self, dt: float) -> None:
        self._dt = dt
        fade, half = exp(-dt / MEMORY), dt / 2
        self._weights[0] = fade, 1, -1, -half, -half
        self._weights[1] = fade, -1, 1, -half, -half
