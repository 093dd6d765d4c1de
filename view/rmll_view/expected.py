"""What the automaton expects of the feet while it is in a state, and which foot is not so."""

import numpy as np
from numpy.typing import NDArray

from rmll_gaits.label import FEET, NUM_LABELS
from rmll_gaits.machine import Machine, explained
from rmll_gaits.table import ADVANCE, REJECT, MachineTable

UP, EITHER, DOWN = 0, 1, 2

_BITS = (np.arange(NUM_LABELS)[:, None] >> np.arange(len(FEET)) & 1).astype(bool)
"""(16, 4), the feet that are down in each label, in the order of ``FEET``"""


def expected(states: NDArray[np.int64], table: MachineTable) -> NDArray[np.int64]:
    """(T, 4) UP, DOWN or EITHER: each foot in the pose that led into the state, for (T,) states."""
    poses = np.full((table.num_states, len(FEET)), EITHER)
    for state in range(table.num_states):
        feet = _BITS[_entry(state, table)]
        poses[state, feet.all(axis=0)] = DOWN
        poses[state, ~feet.any(axis=0)] = UP
    return poses[states]


def at_odds(
    states: NDArray[np.int64], down: NDArray[np.bool_], off_spec: NDArray[np.bool_],
    table: MachineTable,
) -> NDArray[np.bool_]:  # fmt: skip
    """(T, 4): at steps that are ``off_spec`` (T,), the fewest feet that would have to be otherwise.

    Of several choices the one that leads to the pose of the state, (T,), counts.
    """
    wrong = np.zeros(down.shape, bool)
    for step in np.flatnonzero(off_spec):
        state = int(states[step])
        in_order = _in_order(state, table)
        if in_order:
            entry = _entry(state, table)
            differing = [(int((_BITS[label] != down[step]).sum()), label not in entry, label)
                         for label in in_order]  # fmt: skip
            _, _, nearest = min(differing)
            wrong[step] = _BITS[nearest] != down[step]
    return wrong


def _in_order(state: int, table: MachineTable) -> list[int]:
    """Labels that are not off-spec in a state."""
    labels = np.arange(NUM_LABELS)
    fine = explained(Machine.of(table), state, labels) & (table.effect[state] != REJECT)
    return labels[fine].tolist()


def _entry(state: int, table: MachineTable) -> list[int]:
    """Labels that lead into a state; for one that nothing leads to, those to wait with."""
    leads = (table.effect == ADVANCE) & (table.next_state == state)
    return np.flatnonzero(leads.any(axis=0) if leads.any() else table.hold[state]).tolist()
