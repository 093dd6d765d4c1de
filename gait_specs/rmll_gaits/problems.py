"""Why a gait cannot be compiled; every line is an error for ``check`` as for the compiler."""

from collections.abc import Iterator
from itertools import chain, combinations

from rmll_gaits import pose
from rmll_gaits.spec import Edge, GaitSpec, State


def problems(spec: GaitSpec) -> Iterator[str]:
    """One line a problem, with the place in the file; nothing for a sound gait."""
    yield from chain.from_iterable(map(_never_true, spec.states))
    yield from chain.from_iterable(map(_overlaps, spec.states))
    yield from _unreachable(spec)
    for state in spec.states:
        if all(edge.rejects for edge in state.edges):
            yield f"{state.where}: state {state.name} is a dead end, no edge leads on"
    yield from _rejects_the_start(spec)


def _never_true(state: State) -> Iterator[str]:
    for edge in state.edges:
        if not edge.labels:
            yield f"{edge.where}: state {state.name}: {edge.when!r} is true for no contact"


def _overlaps(state: State) -> Iterator[str]:
    for first, second in combinations(state.edges, 2):
        if common := first.labels & second.labels:
            yield (
                f"{second.where}: state {state.name}: contact {pose.to_text(min(common))}"
                f" opens two edges, {_name(first)} and {_name(second)}"
            )


def _rejects_the_start(spec: GaitSpec) -> Iterator[str]:
    """Reject edges that are open before a robot could have lifted a foot."""
    start = next(state for state in spec.states if state.name == spec.start)
    for edge in start.edges:
        if edge.rejects and not edge.grace and pose.ALL_DOWN in edge.labels:
            yield (
                f"{edge.where}: state {start.name}: {edge.when!r} rejects the robot as it starts,"
                " standing on all feet; expected a grace, the policy steps of 20 ms that it has"
                " to lift them, such as 'grace: 20'"
            )


def _name(edge: Edge) -> str:
    return f"{edge.when!r} to {edge.to}"


def _unreachable(spec: GaitSpec) -> Iterator[str]:
    edges = {state.name: state.edges for state in spec.states}
    reached, fresh = {spec.start}, {spec.start}
    while fresh:
        fresh = {e.to for name in fresh for e in edges[name] if not e.rejects} - reached
        reached |= fresh
    for state in spec.states:
        if state.name not in reached:
            yield f"{state.where}: state {state.name} cannot be reached from {spec.start}"
