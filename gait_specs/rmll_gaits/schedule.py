"""When which foot is down: a gait's main cycle at the fastest rate that c_f allows.

Rates are in policy steps, the unit of c_f. An edge that several labels open is stood for by the
lowest of them.
"""

from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rmll_common.errors import InputError
from rmll_gaits.label import NUM_LABELS
from rmll_gaits.pose import BITS, PAPER_FEET
from rmll_gaits.table import ADVANCE, MachineTable

POLICY_HZ = 50
"""The paper's policy rate, for periods in seconds"""


class Phase(NamedTuple):
    """One pose of the cycle: held from the edge it opens until the next edge."""

    state: int
    """The state that the pose leads to, in which the robot waits for the next one"""
    label: int
    dwell: float
    """Factor of c_f of the edge that ends the phase"""


@dataclass(frozen=True)
class Schedule:
    """A gait's main cycle at one c_f."""

    phases: tuple[Phase, ...]
    steps: tuple[int, ...]
    """Policy steps of each phase"""

    @property
    def period_steps(self) -> int:
        return sum(self.steps)

    @property
    def period(self) -> float:
        """[s]"""
        return self.period_steps / POLICY_HZ

    @property
    def duty(self) -> dict[str, float]:
        """Per foot, in the paper's order, the share of the period in contact."""
        phases = list(zip(self.phases, self.steps, strict=True))
        return {
            foot: sum(n for phase, n in phases if phase.label & BITS[foot]) / self.period_steps
            for foot in PAPER_FEET
        }


def schedule(table: MachineTable, frequency: float) -> Schedule:
    """The main cycle at c_f = ``frequency`` [policy steps]."""
    steps = tuple(int(steps) for steps in dwell_steps(table, frequency))
    return Schedule(main_cycle(table), steps)


def transition_rate(table: MachineTable, frequency: Any) -> Any:
    """Transitions per policy step that c_f allows; a float, NumPy array or tensor in, and out.

    Adherence is the transitions made over the sum of this over the policy steps.
    """
    return 1 / mean_dwell(table, frequency)


def mean_dwell(table: MachineTable, frequency: Any) -> Any:
    """Policy steps per transition; types as in :func:`transition_rate`."""
    steps = dwell_steps(table, frequency)
    return sum(steps) / len(steps)


def dwell_steps(table: MachineTable, frequency: Any) -> list[Any]:
    """Least policy steps of each phase of the main cycle; types as in :func:`transition_rate`."""
    return [least_steps(phase.dwell, frequency) for phase in main_cycle(table)]


def least_steps(dwell: Any, frequency: Any) -> Any:
    """Policy steps until a dwell is over, at least one; types as in :func:`transition_rate`."""
    # -(-x // 1) rounds up in Python, NumPy and torch alike
    steps = -(-dwell * frequency // 1)
    return steps + (steps < 1)


@lru_cache(maxsize=8)
def main_cycle(table: MachineTable) -> tuple[Phase, ...]:
    """The shortest cycle through the start state, or else through the nearest state with one."""
    for state in (table.start, *_routes(table, table.start)):
        if route := _routes(table, state).get(state):
            hops = [_successors(table, here)[there] for here, there in pairwise(route)]
            return tuple(
                Phase(there, hop.label, after.dwell)
                for there, hop, after in zip(route[1:], hops, hops[1:] + hops[:1], strict=True)
            )
    raise InputError(f"gait {table.gait}: no cycle leads through or from {table.states[0]}")


def next_labels(table: MachineTable) -> tuple[int, ...]:
    """Per state the label of the pose that it waits for.

    On the main cycle that cycle's next pose, elsewhere the one of the quickest edge; a state that
    no edge leaves, such as the sink, waits for nothing and has all feet down.
    """
    cycle = main_cycle(table)
    after = {
        before.state: phase.label
        for before, phase in zip(cycle, cycle[1:] + cycle[:1], strict=True)
    }
    labels = []
    for state in range(table.num_states):
        hops = _successors(table, state).values()
        quickest = min(hops, default=_Hop(0.0, NUM_LABELS - 1)).label
        labels.append(after.get(state, quickest))
    return tuple(labels)


class _Hop(NamedTuple):
    dwell: float
    label: int


def _routes(table: MachineTable, origin: int) -> dict[int, list[int]]:
    """Shortest routes of one or more edges to each state in reach, both ends in, nearest first."""
    routes: dict[int, list[int]] = {}
    queue = deque([[origin]])
    while queue:
        route = queue.popleft()
        for state in _successors(table, route[-1]):
            if state not in routes:
                routes[state] = [*route, state]
                queue.append(routes[state])
    return routes


def _successors(table: MachineTable, state: int) -> dict[int, _Hop]:
    """The quickest hop to each next state, of several labels the lowest."""
    hops: dict[int, _Hop] = {}
    for label in np.flatnonzero(table.effect[state] == ADVANCE).tolist():
        hop = _Hop(float(table.dwell[state, label]), label)
        target = int(table.next_state[state, label])
        hops[target] = min(hops.get(target, hop), hop)
    return hops
