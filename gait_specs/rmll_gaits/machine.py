"""Stepping a gait's automaton: one definition for the robot (NumPy) and the trainer (torch).

The arrays of a :class:`Machine` are indexed with states and labels of any shape; only operators
that Python scalars, NumPy and torch share are used.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from rmll_gaits.table import ADVANCE, REJECT, MachineTable


class Machine(NamedTuple):
    """The arrays of a table that stepping needs, (states, 16), NumPy or torch."""

    next_state: Any
    effect: Any
    dwell: Any
    grace: Any
    hold: Any

    @classmethod
    def of(
        cls, table: MachineTable, convert: Callable[[Any], Any] = lambda array: array
    ) -> "Machine":
        """``convert`` maps each read-only NumPy array, e.g. to a torch tensor."""
        return cls(*(convert(getattr(table, name)) for name in cls._fields))


class Step(NamedTuple):
    """Outcome of one policy step; shapes as the inputs of :func:`step`."""

    state: Any
    phi: Any
    """Policy steps since the last transition; 0 right after one"""
    advanced: Any
    """Boolean: an edge of the gait was taken, which earns the bonus"""
    rejected: Any
    """Boolean: a reject edge was taken; ``state`` is the sink"""


def step(machine: Machine, state: Any, phi: Any, label: Any, frequency: Any, age: Any) -> Step:
    """Advance the automaton by one policy step.

    Args:
        state: integer states before the step.
        phi: policy steps since the last transition, before the step.
        label: integer contact labels observed now.
        frequency: c_f [policy steps].
        age: policy steps since the episode began (the first step has age 0).
    """
    effect = machine.effect[state, label]
    phi = phi + 1
    advanced = (effect == ADVANCE) & (phi >= machine.dwell[state, label] * frequency)
    rejected = (effect == REJECT) & (age >= machine.grace[state, label])
    taken = advanced | rejected
    state = state + taken * (machine.next_state[state, label] - state)
    return Step(state, phi * (taken == 0), advanced, rejected)


def explained(machine: Machine, state: Any, label: Any) -> Any:
    """Boolean: an edge of the gait or a hold of ``state`` explains ``label``.

    ``state`` is the one BEFORE the step in which the label was observed.
    """
    return machine.hold[state, label] | (machine.effect[state, label] == ADVANCE)
