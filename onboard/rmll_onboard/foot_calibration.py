"""What a foot's raw readings mean: how it reads in the air, and what standing on it adds.

The A1's sensors have a bias of their own, drift, and read below it just after a load. So the
reading in the air is never taken for known: standing gives a first guess of it, and every swing
of a walk measures it anew.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW = 50
"""Policy steps in which a walking foot is both lifted and loaded: the longest stance of the
library's gaits takes 30 of them, the longest swing 36"""
_EVERY = 5
"""Policy steps from one look at a whole window to the next; sensors drift slower than that"""
_GLITCHES = 2
"""So many readings at either end of a window are not believed"""
_NEAR = 1 / 3
"""Share of the load within which readings are taken for the same, of a foot in the air"""
_FEET = np.arange(4)
_SMOOTHING = 0.1
"""Of the readings at rest: a time constant of ten policy steps"""
_DEAD = 0.1
"""A foot that varies by less than this share of what the others do tells nothing"""
_STUCK = 15
"""Policy steps of a walk without any change after which a sensor is taken for dead. A whole window
is too long: the automaton waits for a contact that it is not told of, and some policies then fall.
A working sensor's noise of about one unit is as still as that once in hours of walking, and then
the estimated height stands in until the next change"""


class FootCalibration:
    """Four feet, fed once a policy step with raw readings (4,)."""

    def __init__(self, load: float) -> None:
        """``load``: a first guess of what standing adds to a foot's reading, raw units."""
        self.unloaded = np.zeros(4)
        """The reading in the air, raw units"""
        self.load = np.full(4, float(load))
        """What standing adds to it, raw units"""
        self._mute = np.zeros(4, bool)
        """By the last look at a whole window"""
        self._last = np.zeros(4, np.int32)
        self._still = np.zeros(4, int)
        """Policy steps of this walk since the reading last changed"""
        self._plausible = load / 2, load * 4
        self._lying: Array | None = None
        self._standing: Array | None = None
        self._window = np.zeros((4, WINDOW), np.int32)
        self._count = 0

    @property
    def dead(self) -> NDArray[np.bool_]:
        """(4,) Stuck or cut off: these readings are not of this foot."""
        return self._mute | (self._still >= _STUCK)

    def lie(self, foot_force: NDArray[np.int16]) -> None:
        """The robot lies damped; its feet may be in the air, or not."""
        self._lying = _smoothed(self._lying, foot_force)
        self._count = 0

    def rise(self, foot_force: NDArray[np.int16]) -> None:
        """The robot stands up, which no sensor that works can fail to notice."""
        self.stand(foot_force)
        self._keep(foot_force)

    def stand(self, foot_force: NDArray[np.int16]) -> None:
        """The robot stands on all feet."""
        self._standing = _smoothed(self._standing, foot_force)

    def begin(self) -> None:
        """A walk begins: what standing told becomes the first guess."""
        if self._count >= WINDOW:
            self._judge(self._ordered())
        self._still[:] = 0
        self._count = 0
        if self._standing is None:
            return
        if self._lying is not None:
            # a foot that stood or lay on the ground both times has not told its load
            added = self._standing - self._lying
            self.load = np.where(added >= self.load / 2, added.clip(*self._plausible), self.load)
            self._lying = None
        self.unloaded = self._standing - self.load

    def walk(self, foot_force: NDArray[np.int16]) -> None:
        """Follow the feet of a walking robot."""
        self._still = np.where(foot_force == self._last, self._still + 1, 0)
        self._keep(foot_force)
        seen_before = self._count > WINDOW and self._count % _EVERY
        if self._count <= _GLITCHES or seen_before:
            return
        ordered = self._ordered()
        low, high = ordered[:, _GLITCHES], ordered[:, -1 - _GLITCHES]
        # a reading nearer to the one in the air than to the one of standing is of a lifted foot;
        # if the first guess was too far off for that, a whole window shows the lifted foot
        lifted = low < self.unloaded + self.load / 2
        air = self._in_air(ordered, low)
        if self._count >= WINDOW:
            lifted |= high - low >= self.load / 2
            self._judge(ordered)
        elif self._standing is not None:
            added = (self._standing - air).clip(*self._plausible)
            self.load = np.where(lifted, added, self.load)
        self.unloaded = np.where(lifted, air, self.unloaded)

    def _in_air(self, ordered: NDArray[np.int32], low: NDArray[np.int32]) -> Array:
        """The lower quartile of a window's readings near ``low``, if those are of a lifted foot.

        The lowest ones are of the moment after a load, the highest may be of a light touch.
        """
        near = (ordered < (low + _NEAR * self.load)[:, None]).sum(axis=1)
        return ordered[_FEET, np.maximum(near // 4, _GLITCHES)].astype(float)

    def _keep(self, foot_force: NDArray[np.int16]) -> None:
        self._last[:] = foot_force
        self._window[:, self._count % WINDOW] = foot_force
        self._count += 1

    def _ordered(self) -> NDArray[np.int32]:
        """Each foot's readings in the window, the lowest first."""
        return np.sort(self._window[:, : self._count], axis=1)

    def _judge(self, ordered: NDArray[np.int32]) -> None:
        """A constant reading is dead, and one that hardly moves while the other feet step."""
        spread = ordered[:, -1] - ordered[:, 0]
        others = sorted(spread.tolist())[2]
        self._mute = spread <= (_DEAD * others if others >= self._plausible[0] else 0)


def _smoothed(before: Array | None, foot_force: NDArray[np.int16]) -> Array:
    now = foot_force.astype(float)
    return now if before is None else before + _SMOOTHING * (now - before)
