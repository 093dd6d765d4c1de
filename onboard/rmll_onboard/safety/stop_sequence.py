"""The one way out of walking, whoever ends the walk and why: slow down by the clock, then plant.

At speed a robot that is told to stand tips over, so it first walks on the spot. What the feet feel
has no say in that: where they feel nothing any more the gait would wait on two legs for a contact
that never comes. The poses follow one another as c_f allows instead, each as if it had been felt.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rmll_gaits.label import FEET
from rmll_gaits.schedule import next_labels
from rmll_gaits.table import MachineTable
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.state.modes import NS, Mode, Request


class StopSequence:
    """Turns the wish to end a walk into some steps on the spot, and then the wish. Pure."""

    def __init__(self, table: MachineTable, seconds: float) -> None:
        """``seconds`` on the spot."""
        self.stuck_walks = 0
        """Walks that ended because the gait was stuck"""
        self._poses = _poses(next_labels(table))
        self._duration = int(seconds * NS)
        self._since: int | None = None
        self._then = Request.STAND
        self._stuck = False

    @property
    def under_way(self) -> bool:
        return self._since is not None

    def orders(self, now: int, mode: Mode, wanted: OperatorCommand, stuck: bool) -> OperatorCommand:
        """The orders to follow at ``now`` [ns], instead of those that are ``wanted``.

        WALK calls a stop off, but not that of a gait that is ``stuck``.
        """
        if mode is not Mode.WALKING:
            self._since, self._stuck = None, False
            return wanted
        if stuck and not self._stuck:
            self._stuck = True
            self.stuck_walks += 1
            self._begin(now, self._then if self.under_way else Request.STAND)
        if wanted.request is Request.WALK and not self._stuck:
            self._since = None
        elif wanted.request is Request.STAND or wanted.request is Request.SIT:
            self._begin(now, wanted.request)
        if self._since is None:
            return wanted
        over = now - self._since >= self._duration
        return OperatorCommand(self._then if over else None, (0.0, 0.0, wanted.command[2]))

    def contacts(self, state: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """``touching`` and ``clear`` (4,) of the pose that the automaton's ``state`` waits for."""
        pose = self._poses[state]
        return pose, ~pose

    def _begin(self, now: int, then: Request) -> None:
        self._since = now if self._since is None else self._since
        self._then = then


def _poses(labels: Sequence[int]) -> NDArray[np.bool_]:
    """(states, 4) feet that are down."""
    return np.array(labels)[:, None] >> np.arange(len(FEET)) & 1 > 0
