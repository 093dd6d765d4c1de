"""How well a recorded walk keeps to its gait: the log's labels through the automaton once more."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from rmll_common.errors import InputError
from rmll_gaits.adherence import GaitProgress
from rmll_gaits.label import FEET, NUM_LABELS
from rmll_gaits.pose import to_text
from rmll_gaits.schedule import POLICY_HZ, schedule, transition_rate
from rmll_gaits.table import MachineTable
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.state.modes import NS, Mode
from rmll_view.contact_diagram import full_cycles

GAP = 1.5 / POLICY_HZ
"""[s] between two rows that do not follow each other: ticks are missing there"""
LONGEST = 1000.0
"""c_f [policy steps] and factor of it that no gait has"""


class ConformanceRow(msgspec.Struct, frozen=True):
    """What is wanted of a log's row."""

    t_ns: Annotated[int, Meta(ge=0, lt=1 << 62)]
    mode: str
    label: Annotated[int, Meta(ge=0, lt=NUM_LABELS)]
    state: str
    phi: Annotated[int, Meta(ge=0, lt=1 << 31)]
    frequency: float


@dataclass(frozen=True)
class RecordedWalk:
    """A stretch of walking without a break, judged. Arrays are (T,), one entry a policy step."""

    times: NDArray[np.float64]
    """[s]"""
    labels: NDArray[np.int64]
    states: NDArray[np.int64]
    """After the step"""
    advanced: NDArray[np.bool_]
    off_spec: NDArray[np.bool_]
    dwell: NDArray[np.int64]
    """Policy steps that were spent in the state which the step has left; where it advanced"""
    frequency: NDArray[np.float64]
    """c_f [policy steps]"""
    contradictions: int
    """Steps at which the daemon had another state"""

    @property
    def down(self) -> NDArray[np.bool_]:
        """(T, 4) in contact, feet in the order of ``rmll_gaits.label.FEET``."""
        return (self.labels[:, None] >> np.arange(len(FEET)) & 1).astype(bool)

    @property
    def left(self) -> NDArray[np.int64]:
        """States before each step."""
        return np.concatenate((self.states[:1], self.states[:-1]))


@dataclass(frozen=True)
class Dwell:
    """Time spent in a state, in policy steps."""

    visits: int
    least: int
    mean: float
    most: int
    allowed: int | None
    """The least by the mean c_f; None outside the main cycle"""


@dataclass(frozen=True)
class Conformance:
    """What a log's walks come to."""

    gait: str
    walks: int
    seconds: float
    frequency: float
    """Mean c_f [policy steps]"""
    transitions: int
    adherence: float
    """Transitions over those that c_f allows"""
    cycles: int
    """Full rounds of the main cycle"""
    cycle_rate: float | None
    """[Hz] of these; None without one"""
    cycle_rate_allowed: float
    """[Hz] the quickest by the mean c_f"""
    off_spec_contact: float
    """Share of the policy steps whose label the automaton does not explain"""
    off_spec_steps: dict[str, int]
    """How many, by state and feet in contact, the most frequent first"""
    contradictions: int
    """Policy steps at which the daemon was in another state than this judge"""
    dwell: dict[str, Dwell] = field(default_factory=dict)


def walks(log: FlightLog) -> list[RecordedWalk]:
    """The log's walks, put through the automaton; raises InputError if there is none."""
    table = log.about.machine_table()
    if table.dwell.max() > LONGEST:
        raise InputError(f"{log.source}: its gait dwells {table.dwell.max():g} times c_f")
    found = [_judge(rows, table, log.source) for rows in _stretches(log)]
    if not found:
        raise InputError(f"{log.source}: the robot does not walk in it")
    return found


def conformance(found: Sequence[RecordedWalk], table: MachineTable) -> Conformance:
    """What ``found``, at least one walk, comes to."""
    frequency = np.concatenate([walk.frequency for walk in found])
    advanced = np.concatenate([walk.advanced for walk in found])
    off_spec = np.concatenate([walk.off_spec for walk in found])
    cycles = [end - start for walk in found
              for start, end in full_cycles(walk.times, walk.states, table)]  # fmt: skip
    allowed = sum(float(transition_rate(table, value)) for value in frequency.tolist())
    mean_frequency = float(frequency.mean())
    return Conformance(
        gait=table.gait,
        walks=len(found),
        seconds=len(frequency) / POLICY_HZ,
        frequency=mean_frequency,
        transitions=int(advanced.sum()),
        adherence=int(advanced.sum()) / allowed,
        cycles=len(cycles),
        cycle_rate=1 / fmean(cycles) if cycles else None,
        cycle_rate_allowed=1 / schedule(table, mean_frequency).period,
        off_spec_contact=float(off_spec.mean()),
        off_spec_steps=_unexplained(found, table),
        contradictions=sum(walk.contradictions for walk in found),
        dwell=_dwell(found, table, mean_frequency),
    )


def _stretches(log: FlightLog) -> Iterator[list[ConformanceRow]]:
    """Rows of each walk."""
    rows: list[ConformanceRow] = []
    for row in log.rows_of(ConformanceRow):
        walking = row.mode == Mode.WALKING
        if rows and not (walking and 0 < row.t_ns - rows[-1].t_ns <= GAP * NS):
            yield rows
            rows = []
        if walking:
            rows.append(row)
    if rows:
        yield rows


def _judge(rows: list[ConformanceRow], table: MachineTable, source: str) -> RecordedWalk:
    """Where a log has a gap, the daemon's word is taken for where the robot was after it."""
    states = {name: index for index, name in enumerate(table.states)}
    if strange := {row.state for row in rows} - set(states):
        raise InputError(f"{source}: state {min(strange)!r} is none of the gait's")
    for row in rows:
        if not 0 < row.frequency <= LONGEST:
            raise InputError(f"{source}: walks with a c_f of {row.frequency:g}")
    progress = GaitProgress(table)
    progress.state, progress.phi = states[rows[0].state], rows[0].phi
    steps = []
    for row in rows:
        phi = progress.phi
        progress.step(row.label, row.frequency)
        steps.append((progress.state, progress.advanced, progress.off_spec, phi + 1))
    recorded = np.array([states[row.state] for row in rows])
    after, advanced, off_spec, dwell = (np.array(column) for column in zip(*steps, strict=True))
    return RecordedWalk(
        times=np.array([row.t_ns for row in rows]) / NS,
        labels=np.array([row.label for row in rows]),
        states=after,
        advanced=advanced,
        off_spec=off_spec,
        dwell=dwell,
        frequency=np.array([row.frequency for row in rows]),
        contradictions=int((after != recorded).sum()),
    )


def _unexplained(found: Sequence[RecordedWalk], table: MachineTable) -> dict[str, int]:
    counts: dict[str, int] = {}
    for walk in found:
        at = walk.off_spec
        for state, label in zip(walk.left[at].tolist(), walk.labels[at].tolist(), strict=True):
            name = f"{table.states[state]}: {to_text(label)}"
            counts[name] = counts.get(name, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: -item[1]))


def _dwell(
    found: Sequence[RecordedWalk], table: MachineTable, frequency: float
) -> dict[str, Dwell]:
    cycle = schedule(table, frequency)
    allowed = {phase.state: n for phase, n in zip(cycle.phases, cycle.steps, strict=True)}
    dwell = {}
    for state, name in enumerate(table.states):
        steps = [int(n) for walk in found
                 for n in walk.dwell[walk.advanced & (walk.left == state)]]  # fmt: skip
        if steps:
            dwell[name] = Dwell(
                len(steps), min(steps), fmean(steps), max(steps), allowed.get(state)
            )
    return dwell
