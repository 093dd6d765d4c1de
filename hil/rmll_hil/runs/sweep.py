"""A walk that goes through several values of c_f: the figures of each, and a picture of all."""

from collections.abc import Sequence
from pathlib import Path

from rmll_gaits.label import FEET
from rmll_gaits.schedule import transition_rate
from rmll_gaits.table import MachineTable
from rmll_hil.runs.metrics import SweepPhase
from rmll_hil.runs.outcome import Outcome, column, times
from rmll_onboard.recording.telemetry import TelemetryRow
from rmll_onboard.state.modes import Mode


def phases(
    outcome: Outcome, table: MachineTable, frequencies: tuple[float, ...], seconds: float
) -> tuple[SweepPhase, ...]:
    """Figures of each value's equal share of a walk of ``seconds``; those not reached are left out.

    c_f follows at a limited rate. What is allowed is counted by what the policy was told, so the
    way from one value to the next is part of the share that it begins.
    """
    rows, report = _walk(outcome), outcome.report
    if not rows or report.walking_start_ns is None or report.walking_end_ns is None:
        return ()
    stamps, told, advanced = times(rows), column(rows, "frequency"), column(rows, "advanced")
    length = seconds * 1e9 / len(frequencies)
    found = []
    for index, frequency in enumerate(frequencies):
        begin = report.walking_start_ns + index * length
        own = (stamps >= begin) & (stamps < begin + length)
        if not own.any():
            break
        made, allowed = int(advanced[own].sum()), float(transition_rate(table, told[own]).sum())
        walked = min(length, report.walking_end_ns - begin) / 1e9
        found.append(SweepPhase(frequency, walked, made, made / allowed))
    return tuple(found)


def draw(path: Path, outcome: Outcome, found: Sequence[SweepPhase], title: str) -> None:
    """Save the picture of the walk, with what :func:`phases` found, at least one."""
    from rmll_view.frequency import Share, frequency_figure

    rows = _walk(outcome)
    shares, start = [], 0.0
    for phase in found:
        end = start + phase.seconds
        text = f"c_f {phase.frequency:g}\nadherence {phase.adherence:.2f}"
        shares.append(Share(start, end, text))
        start = end
    stamps = times(rows)
    frequency_figure(
        path,
        (stamps - stamps[0]) / 1e9,
        column(rows, *(f"down_{foot}" for foot in FEET)).astype(bool),
        column(rows, "frequency"),
        column(rows, "advanced").astype(bool),
        shares,
        title,
    )


def _walk(outcome: Outcome) -> list[TelemetryRow]:
    """The log's rows of walking, without the halt."""
    start, end = outcome.report.walking_start_ns, outcome.report.walking_end_ns
    if start is None or end is None:
        return []
    return [r for r in outcome.log if start <= r.t_ns <= end and r.mode == Mode.WALKING]
