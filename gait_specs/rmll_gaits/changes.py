"""What differs between two versions of a gait, in words."""

from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from rmll_gaits import pose
from rmll_gaits.table import Commands, MachineTable

_RULES = ("effect", "dwell", "grace", "hold")


def changes(before: MachineTable, after: MachineTable) -> Iterator[str]:
    """One text a difference: states, commands, and the contacts whose rules differ in a state."""
    for field in fields(Commands):
        old, new = (getattr(table.commands, field.name) for table in (before, after))
        if old != new:
            yield f"commands {field.name}: {_range(old)}, now {_range(new)}"
    if before.states != after.states:
        yield f"states: {', '.join(before.states)}, now {', '.join(after.states)}"
        return  # the rules of other states cannot be compared
    if before.start != after.start:
        yield f"start: {before.states[before.start]}, now {after.states[after.start]}"
    differs = before.next_state != after.next_state
    for name in _RULES:
        differs = differs | (getattr(before, name) != getattr(after, name))
    for state in np.flatnonzero(differs.any(1)):
        feet = ", ".join(pose.to_text(int(label)) for label in np.flatnonzero(differs[state]))
        yield f"rules of {before.states[state]} for {feet}"


def _range(values: tuple[float, float]) -> str:
    return f"[{values[0]:g}, {values[1]:g}]"
