"""What a run leaves behind: the daemon's own report and log, and the truth beside them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rmll_gaits.table import MachineTable
from rmll_onboard.recording.telemetry import TelemetryRow
from rmll_onboard.state.reports import RunReport

AFTERMATH = 2.0
"""[s] that the robot is watched after a fault: a damped one that tips over takes its time"""


@dataclass(frozen=True)
class Outcome:
    """One finished run. All times are of one clock [ns]."""

    report: RunReport
    """The daemon's: what it walked, its fault if any, its datagrams and timings"""
    log: Sequence[TelemetryRow]
    """The daemon's inside, one :func:`rmll_onboard.recording.telemetry.row` a policy step"""
    truth: NDArray[np.void]
    """Samples of type :data:`rmll_hil.robot.emulator.TRUTH`, rising in time"""
    realtime_factor: float
    """The robot's time over the wall's"""


def times(log: Sequence[TelemetryRow]) -> NDArray[np.int64]:
    """(n,) [ns]"""
    return np.array([row.t_ns for row in log], np.int64)


def column(log: Sequence[TelemetryRow], *names: str) -> NDArray[np.float64]:
    """(n, number of names), or (n,) for one name; what was no number is NaN."""
    # None becomes NaN
    values = np.array([[getattr(row, name) for name in names] for row in log], np.float64)
    return values[:, 0] if len(names) == 1 else values


def states(log: Sequence[TelemetryRow], table: MachineTable) -> NDArray[np.int64]:
    """(n,) indices of the automaton's states."""
    return np.array([table.states.index(row.state) for row in log], np.int64)


def at(stamps: NDArray[np.int64], moments: NDArray[np.int64]) -> NDArray[np.intp]:
    """Index of the newest stamp at each moment; moments before the first stamp get index 0."""
    return (np.searchsorted(stamps, moments, side="right") - 1).clip(0)
