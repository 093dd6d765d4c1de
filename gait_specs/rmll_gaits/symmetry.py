"""Mirror symmetry of a gait: which state is which when left and right feet change places."""

from typing import Any

import numpy as np

from rmll_gaits.label import FEET, NUM_LABELS
from rmll_gaits.table import MachineTable

MIRROR_FEET = tuple(FEET.index(foot[0] + {"L": "R", "R": "L"}[foot[1]]) for foot in FEET)
"""Index of the foot that each of ``FEET`` is in a mirror"""

_RIGHT, _LEFT = 0b0101, 0b1010
_ALL_DOWN = NUM_LABELS - 1


def mirror_label(label: Any) -> Any:
    """Labels with left and right feet swapped; integers, NumPy arrays or torch tensors."""
    return (label & _RIGHT) << 1 | (label & _LEFT) >> 1


_LABELS = mirror_label(np.arange(NUM_LABELS))


def mirror_states(table: MachineTable) -> tuple[int, ...] | None:
    """The mirror image of each state, or None if the gait has no mirror symmetry.

    An automorphism of the automaton: the mirrored label leads from a state's image to the image
    of the state that the label leads to, with the same effect and dwell, and holds are mirrored
    too. It need not keep the start state (a trot's two states change places), and it is its own
    inverse.

    Two things may differ, for they belong to the beginning of an episode, which no mirror moves
    from the start state elsewhere: ``grace``, and standing on all feet as a hold of the start
    state.
    """
    others = (state for state in range(table.num_states) if state != table.start)
    for image in (table.start, *others):
        images = _propagate(table, image)
        if _is_symmetry(table, images):
            return tuple(images.tolist())
    return None


def _propagate(table: MachineTable, image: int) -> np.ndarray:
    """Images (states,) that follow from the start state's; states out of its reach keep theirs."""
    images = {table.start: image}
    queue = [table.start]
    for state in queue:
        mirrored = table.next_state[images[state], _LABELS]
        for target, target_image in zip(table.next_state[state], mirrored, strict=True):
            if int(target) not in images:
                images[int(target)] = int(target_image)
                queue.append(int(target))
    return np.array([images.get(state, state) for state in range(table.num_states)])


def _is_symmetry(table: MachineTable, images: np.ndarray) -> bool:
    def mirrored(array: np.ndarray) -> np.ndarray:
        return array[images][:, _LABELS]

    hold = table.hold.copy()
    hold[[table.start, images[table.start]], _ALL_DOWN] = True
    return bool(
        (images[images] == np.arange(table.num_states)).all()
        and (mirrored(table.next_state) == images[table.next_state]).all()
        and (mirrored(table.effect) == table.effect).all()
        and (mirrored(table.dwell) == table.dwell).all()
        and (mirrored(hold) == hold).all()
    )
