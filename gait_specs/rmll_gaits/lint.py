"""What is wrong, or only doubtful, in a gait, found before anyone trains it."""

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from rmll_gaits import pose
from rmll_gaits.compile import compile_gait
from rmll_gaits.flight import flights
from rmll_gaits.label import NUM_LABELS
from rmll_gaits.problems import problems
from rmll_gaits.schedule import schedule
from rmll_gaits.spec import GaitSpec
from rmll_gaits.table import ADVANCE, MachineTable

PERIODS = (0.2, 2.0)
"""[s] Strides of animals and robots of a dog's size lie within"""


class Finding(NamedTuple):
    level: Literal["error", "warning"]
    message: str


def lint(spec: GaitSpec) -> list[Finding]:
    """Everything there is to say; a gait with errors does not compile and gets no warnings."""
    if errors := [Finding("error", problem) for problem in problems(spec)]:
        return errors
    table = compile_gait(spec)
    warnings = (
        *_poses(spec),
        *_standing_still(table),
        *_unpaced(table),
        *_periods(table),
        *flights(table),
    )
    return [Finding("warning", f"{spec.source}: {warning}") for warning in warnings]


def _poses(spec: GaitSpec) -> Iterator[str]:
    """Poses that an edge insists on although nobody can stand in them."""
    edges = (edge for state in spec.states for edge in state.edges if not edge.rejects)
    demands = dict.fromkeys(edge.labels for edge in edges)
    for labels in demands:
        if all(map(_weakness, labels)):
            label = min(labels)
            name, weakness = pose.to_text(label), _weakness(label)
            yield f"pose {name}: {weakness}, which carries a robot only briefly"


def _weakness(label: int) -> str:
    """Why a robot tips over in a pose; empty when it need not."""
    names = pose.to_text(label).split()
    if label == 0:
        return "all feet in the air"
    if len(names) == 1:
        return "a single foot down"
    sides = {"FL FR": "front", "BL BR": "back", "FL BL": "left", "FR BR": "right"}
    side = sides.get(" ".join(names))
    return f"only the {side} feet down" if side else ""


def _standing_still(table: MachineTable) -> Iterator[str]:
    for label in range(NUM_LABELS):
        edges = {
            int(state): {int(table.next_state[state, label])}
            for state in np.flatnonzero(table.effect[:, label] == ADVANCE)
        }
        if _endless(edges):
            yield f"a robot that stands still in {pose.to_text(label)} earns bonus after bonus"


def _unpaced(table: MachineTable) -> Iterator[str]:
    at_once = (table.effect == ADVANCE) & (table.dwell == 0)
    edges = {
        state: set(table.next_state[state, at_once[state]].tolist())
        for state in range(table.num_states)
    }
    if states := _endless(edges):
        names = ", ".join(table.states[state] for state in sorted(states))
        yield f"a cycle of edges with dwell 0 (through {names}) goes round at any c_f"


def _endless(edges: dict[int, set[int]]) -> set[int]:
    """States from which the edges can be followed for ever."""
    alive = set(edges)
    while stuck := {state for state in alive if not edges[state] & alive}:
        alive -= stuck
    return alive


def _periods(table: MachineTable) -> Iterator[str]:
    shortest, longest = PERIODS
    for frequency in dict.fromkeys(table.commands.frequency):
        period = schedule(table, frequency).period
        if not shortest <= period <= longest:
            yield (
                f"at frequency {frequency:g} a cycle takes {period:.2f} s,"
                f" plausible are {shortest:g} to {longest:g} s"
            )
