"""The automaton as a monitor: a gait that makes no transitions is not walking."""

from rmll_gaits.table import ADVANCE, MachineTable

_LONGEST_DWELL = 1.0
"""c_f's; a gait of short dwells may take so long too"""


class GaitMonitor:
    """Knows how long a state of the gait can last."""

    def __init__(self, table: MachineTable, factor: float) -> None:
        """``factor``: so many times longer than it has to is too long."""
        dwell = table.dwell[table.effect == ADVANCE].max(initial=_LONGEST_DWELL)
        self._factor = factor * float(dwell)

    def stuck(self, phi: int, frequency: float) -> bool:
        """``phi``: policy steps since the last transition; ``frequency``: c_f."""
        return phi > self._factor * frequency
