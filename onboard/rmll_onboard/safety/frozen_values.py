"""Values that stay the same although the robot moves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.settings.runtime_settings import Safety
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import Robot

_TRAIL = 32
"""States kept, one of each four, to tell the motion since a value last changed"""
_MOTION = 0.05
"""[rad] of motion; values that stay the same meanwhile are doubted"""
_NEEDED = "orientation", "gyroscope", "joint angles", "joint speeds", "joint torques"
"""What policy and guard cannot do without"""


class FrozenValues:
    """Which stay the same although the robot moves; each group of them alone."""

    def __init__(self, robot: Robot, spare: Sequence[str], safety: Safety) -> None:
        """``spare``: the state's fields that there are and that the robot can do without."""
        self.needed: str | None = None
        """What is told of a group that the robot needs"""
        self.spare: tuple[str, str] | None = None
        """The group, and what is told of it, of those that it can do without"""
        self._names = [*_NEEDED, *spare]
        self._patience = safety.frozen_ms * 1e6
        groups = len(self._names)
        self._last = [b""] * groups
        self._changed = [0] * groups  # [ns] when each group last changed
        self._count = [0] * groups  # looks since then
        self._row = 0
        self._q = np.zeros((_TRAIL, len(robot.joint_names)))
        self._quaternion = np.zeros((_TRAIL, 4))

    def measure(self, now: int, state: RobotState) -> None:
        """Compare with the values of the last look."""
        row = self._row = (self._row + 1) % _TRAIL
        self._q[row], self._quaternion[row] = state.q, state.quaternion
        last, changed, count = self._last, self._changed, self._count
        self.needed = self.spare = None
        for group, array in enumerate(self._arrays(state)):
            data = array.tobytes()
            if data != last[group]:
                last[group], changed[group], count[group] = data, now, 0
                continue
            count[group] += 1
            if now - changed[group] > self._patience:
                self._tell(group, now)

    def _arrays(self, state: RobotState) -> Sequence[NDArray]:
        arrays = state.quaternion, state.gyro, state.q, state.dq, state.tau
        spare = (getattr(state, name) for name in self._names[len(_NEEDED) :])
        return *arrays, *spare

    def _tell(self, group: int, now: int) -> None:
        if (turned := self._motion(self._count[group])) <= _MOTION:
            return
        age = (now - self._changed[group]) / 1e6
        name = self._names[group]
        text = (
            f"{name}: the same values for {age:.0f} ms, in which the robot turned by "
            f"{turned:.2f} rad"
        )
        if group < len(_NEEDED):
            self.needed = self.needed or text
        else:
            self.spare = self.spare or (name, text)

    def _motion(self, looks: int) -> float:
        """[rad] in the last looks: the joint, or the base, that turned most."""
        row, then = self._row, self._row - min(looks, _TRAIL - 1)
        joints = float(np.abs(self._q[row] - self._q[then]).max())
        new, old = self._quaternion[row], self._quaternion[then]
        # both signs are the same orientation
        base = 2 * float(min(np.abs(new - old).max(), np.abs(new + old).max()))
        return max(joints, base)
