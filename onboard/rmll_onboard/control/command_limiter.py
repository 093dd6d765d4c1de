"""Commands change gradually, and never leave what was trained."""

from math import isfinite

from rmll_gaits.table import Commands
from rmll_onboard.settings.runtime_settings import Steering

Command = tuple[float, float, float]
"""vx [m/s], wz [rad/s], c_f [policy steps]"""


class CommandRateLimiter:
    """What the policy is told, on the way to what the operator wants. Pure; once a policy step."""

    def __init__(self, trained: Commands, steering: Steering, policy_hz: int) -> None:
        self._limits = trained.vx, trained.wz, trained.frequency
        rates = steering.acceleration, steering.turning, steering.frequency
        self._steps = [rate / policy_hz for rate in rates]
        self._now: Command = 0.0, 0.0, trained.frequency[0]

    def reset(self, wanted: Command) -> None:
        """A walk begins: from rest, at the pace that is wanted."""
        self._now = self._clamped((0.0, 0.0, wanted[2]))

    def step(self, wanted: Command) -> Command:
        """One step towards ``wanted``; what is no number changes nothing."""
        limited = [
            min(max(goal, now - step), now + step)
            for goal, now, step in zip(self._clamped(wanted), self._now, self._steps, strict=True)
        ]
        self._now = limited[0], limited[1], limited[2]
        return self._now

    def _clamped(self, wanted: Command) -> Command:
        vx, wz, frequency = (
            min(max(value, low), high) if isfinite(value) else before
            for value, before, (low, high) in zip(wanted, self._now, self._limits, strict=True)
        )
        return vx, wz, frequency
