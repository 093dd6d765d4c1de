"""A gait as its author wrote it: the YAML file, read and checked, not yet compiled.

Two forms. In full, states with guarded edges; or, for a plain cycle, the poses in order::

    gait: trot
    commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}
    cycle: [FL BR, FR BL]
"""

from dataclasses import dataclass

from rmll_common import yaml_document
from rmll_common.errors import InputError
from rmll_common.yaml_document import LARGEST, Value
from rmll_gaits import formula, pose
from rmll_gaits.table import MAX_STATES, Commands

MAX_EDGES = 32
"""Of one state; there are only 16 labels"""

SINK = "q_r"
"""The sink's name in the paper; it is never written in a file"""


@dataclass(frozen=True)
class Edge:
    """One guarded edge. A reject edge leads to the sink."""

    when: str
    labels: frozenset[int]
    """Contact labels for which the guard is true"""
    to: str
    dwell: float
    """Factor of c_f; 0 for a reject edge, which is never held back"""
    grace: int
    """Policy steps of an episode in which a reject edge stays closed"""
    where: str
    """``file:line:column`` of the guard"""

    @property
    def rejects(self) -> bool:
        return self.to == SINK


@dataclass(frozen=True)
class State:
    name: str
    edges: tuple[Edge, ...]
    hold: frozenset[int] | None
    """Labels expected while waiting here; None = those that lead here"""
    where: str


@dataclass(frozen=True)
class GaitSpec:
    gait: str
    description: str
    commands: Commands
    start: str
    states: tuple[State, ...]
    source: str
    """What errors call the file"""

    @property
    def rejects(self) -> bool:
        """Whether any edge leads to the sink."""
        return any(edge.rejects for state in self.states for edge in state.edges)


def read_spec(text: str, source: str) -> GaitSpec:
    """The gait in a YAML text; ``source`` names the file in errors.

    Raises InputError, one line with line and column, for anything that is no gait.
    """
    root = yaml_document.read(text, source)
    entries = root.mapping(
        allowed=("gait", "description", "commands", "start", "states", "cycle"),
        required=("gait", "commands"),
    )
    if ("states" in entries) == ("cycle" in entries):
        found = "both" if "states" in entries else "neither"
        raise root.error(f"found {found} of 'states' and 'cycle', expected one")
    if "cycle" in entries:
        if "start" in entries:
            raise entries["start"].error(
                "a cycle starts at its first pose, 'start' is for 'states'"
            )
        states = _cycle(entries["cycle"])
        start = states[0].name
    else:
        states = _states(entries["states"])
        start = states[0].name
        if "start" in entries:
            start = _known(entries["start"], [state.name for state in states])
    return GaitSpec(
        gait=entries["gait"].name(),
        description=entries["description"].line() if "description" in entries else "",
        commands=_commands(entries["commands"]),
        start=start,
        states=states,
        source=source,
    )


def _commands(value: Value) -> Commands:
    keys = ("vx", "wz", "frequency")
    entries = value.mapping(allowed=keys, required=keys)
    return Commands(
        vx=_range(entries["vx"]),
        wz=_range(entries["wz"]),
        frequency=_range(entries["frequency"], least=1),
    )


def _range(value: Value, least: float = -LARGEST) -> tuple[float, float]:
    low, high = (item.number(least) for item in value.items(2, 2))
    if low > high:
        raise value.error(f"the range runs down from {low:g} to {high:g}")
    return low, high


def _cycle(value: Value) -> tuple[State, ...]:
    """States q0, q1, ... of which each waits for its pose and leads to the next."""
    items = value.items(2, MAX_STATES - 1)
    return tuple(
        State(f"q{i}", (_pose(item, to=f"q{(i + 1) % len(items)}"),), None, item.where)
        for i, item in enumerate(items)
    )


def _pose(value: Value, to: str) -> Edge:
    dwell = 1.0
    feet = value
    if value.is_mapping:
        entries = value.mapping(allowed=("feet", "dwell"), required=("feet",))
        feet = entries["feet"]
        dwell = entries["dwell"].number(least=0) if "dwell" in entries else dwell
    text = feet.text()
    try:
        label = pose.to_label(text)
    except InputError as error:
        raise feet.error(str(error)) from None
    return Edge(pose.to_guard(label), frozenset({label}), to, dwell, 0, feet.where)


def _states(value: Value) -> tuple[State, ...]:
    entries = value.mapping(names=True)
    if not 0 < len(entries) < MAX_STATES:
        raise value.error(f"{len(entries)} states, expected 1 to {MAX_STATES - 1}")
    for name in entries:
        if name == SINK:
            raise value.error(f"state {SINK} is made by 'reject: true', it cannot be written")
    return tuple(_state(name, entry, list(entries)) for name, entry in entries.items())


def _state(name: str, value: Value, names: list[str]) -> State:
    hold = None
    edges = value
    if value.is_mapping:
        entries = value.mapping(allowed=("edges", "hold"), required=("edges",))
        edges = entries["edges"]
        hold = _guard(entries["hold"]) if "hold" in entries else None
    items = edges.items(0, MAX_EDGES)
    return State(name, tuple(_edge(item, names) for item in items), hold, value.where)


def _edge(value: Value, names: list[str]) -> Edge:
    entries = value.mapping(allowed=("when", "to", "dwell", "reject", "grace"), required=("when",))
    guard = entries["when"]
    labels = _guard(guard)
    if "reject" in entries:
        entries["reject"].true()
        _only_with(entries, "to", "dwell", what="an edge that does not reject")
        grace = entries["grace"].count() if "grace" in entries else 0
        return Edge(guard.text(), labels, SINK, 0.0, grace, guard.where)
    if "to" not in entries:
        raise value.error("expected 'to: STATE' or 'reject: true'")
    _only_with(entries, "grace", what="'reject: true'")
    dwell = entries["dwell"].number(least=0) if "dwell" in entries else 1.0
    return Edge(guard.text(), labels, _known(entries["to"], names), dwell, 0, guard.where)


def _guard(value: Value) -> frozenset[int]:
    try:
        return formula.parse(value.text())
    except formula.FormulaError as error:
        raise value.error(error.problem, error.column) from None


def _known(value: Value, names: list[str]) -> str:
    if (name := value.text()) not in names:
        raise value.error(f"no state {name!r}, expected one of {', '.join(names)}")
    return name


def _only_with(entries: yaml_document.Mapping, *keys: str, what: str) -> None:
    for key in keys:
        if key in entries:
            raise entries[key].error(f"{key!r} goes with {what}")
