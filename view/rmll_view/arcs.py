"""A table's edges as people draw them: one arc for all labels that do the same.

The labels of an arc are shown as few contact patterns: per foot down, up, or either.
"""

from collections.abc import Collection
from itertools import product
from typing import NamedTuple

import numpy as np

from rmll_gaits.pose import BITS, PAPER_FEET
from rmll_gaits.table import REJECT, STAY, MachineTable

Pattern = tuple[bool | None, ...]
"""Per foot of ``PAPER_FEET``: in contact, in the air, or None for either"""


class Arc(NamedTuple):
    """Edges that share their ends and their conditions."""

    source: int
    target: int
    rejects: bool
    dwell: float
    """Factor of c_f"""
    grace: int
    """[policy steps]"""
    patterns: tuple[Pattern, ...]

    @property
    def condition(self) -> str:
        """When the arc is open, with phi and N as in the paper; empty for an arc always open."""
        if self.rejects:
            return f"from step {self.grace} on" if self.grace else ""
        if self.dwell == 0:
            return "at once"
        factor = "" if self.dwell == 1 else f"{self.dwell:g} "
        return "φ ≥ N/2" if self.dwell == 0.5 else f"φ ≥ {factor}N"


def arcs(table: MachineTable) -> list[Arc]:
    """All arcs of a table, by source and then by target."""
    labels: dict[tuple[int, int, bool, float, int], list[int]] = {}
    for source, label in np.argwhere(table.effect != STAY).tolist():
        cell = (source, label)
        key = (
            source,
            int(table.next_state[cell]),
            bool(table.effect[cell] == REJECT),
            float(table.dwell[cell]),
            int(table.grace[cell]),
        )
        labels.setdefault(key, []).append(label)
    return [Arc(*key, cover(found)) for key, found in sorted(labels.items())]


def cover(labels: Collection[int]) -> tuple[Pattern, ...]:
    """Patterns that together match exactly these labels, the widest first."""
    patterns = sorted(product((True, False, None), repeat=len(PAPER_FEET)), key=_width)
    wanted, left, chosen = set(labels), set(labels), []
    while left:
        fitting = (p for p in patterns if _matches(p) <= wanted)
        best = max(fitting, key=lambda pattern: len(_matches(pattern) & left))
        chosen.append(best)
        left -= _matches(best)
    return tuple(chosen)


def _width(pattern: Pattern) -> int:
    return -pattern.count(None)


def _matches(pattern: Pattern) -> set[int]:
    """Labels that a pattern matches."""
    options = (
        (0, BITS[foot]) if down is None else (BITS[foot] * down,)
        for foot, down in zip(PAPER_FEET, pattern, strict=True)
    )
    return {sum(bits) for bits in product(*options)}
