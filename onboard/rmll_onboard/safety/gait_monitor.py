"""The automaton as a monitor: a gait that makes no transitions is not walking."""

import numpy as np

from rmll_gaits.label import FEET
from rmll_gaits.table import ADVANCE, MachineTable

_LONGEST_DWELL = 1.0
"""c_f's; a gait of short dwells may take so long too"""


class GaitMonitor:
    """Knows how long a state of the gait can last."""

    def __init__(self, table: MachineTable, factor: float) -> None:
        """``factor``: so many times longer than it has to is too long."""
        self._effect = table.effect
        dwell = table.dwell[table.effect == ADVANCE].max(initial=_LONGEST_DWELL)
        self._factor = factor * float(dwell)

    def stuck(self, phi: int, frequency: float) -> bool:
        """``phi``: policy steps since the last transition; ``frequency``: c_f."""
        return phi > self._factor * frequency

    def awaited(self, state: int, label: int) -> list[tuple[int, bool]]:
        """The feet, by index, that differ from the nearest label with an edge of the gait.

        With each, whether it should be on the ground. Empty if the gait is free to go on.
        """
        edges = np.flatnonzero(self._effect[state] == ADVANCE).tolist()
        nearest = min(edges, key=lambda edge: (edge ^ label).bit_count(), default=label)
        feet = range(len(FEET))
        return [(f, bool(nearest >> f & 1)) for f in feet if (nearest ^ label) >> f & 1]
