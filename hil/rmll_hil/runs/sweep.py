"""A walk that goes through several values of c_f: the figures of each, and a picture of all."""

from pathlib import Path
from typing import Any

from rmll_gaits.label import FEET
from rmll_gaits.schedule import transition_rate
from rmll_gaits.table import MachineTable
from rmll_hil.runs.outcome import Outcome, column, times


def phases(
    outcome: Outcome, table: MachineTable, frequencies: tuple[float, ...], seconds: float
) -> list[dict[str, Any]]:
    """Figures of each value's equal share of a walk of ``seconds``; those not reached are left out.

    c_f follows at a limited rate. What is allowed is counted by what the policy was told, so the
    way from one value to the next is part of the share that it begins.
    """
    rows = _walk(outcome)
    if not rows:
        return []
    stamps, told, advanced = times(rows), column(rows, "frequency"), column(rows, "advanced")
    length = seconds * 1e9 / len(frequencies)
    found = []
    for index, frequency in enumerate(frequencies):
        begin = outcome.report["walking_start_ns"] + index * length
        own = (stamps >= begin) & (stamps < begin + length)
        if not own.any():
            break
        made, allowed = int(advanced[own].sum()), float(transition_rate(table, told[own]).sum())
        found.append(
            {
                "frequency": frequency,
                "seconds": min(length, outcome.report["walking_end_ns"] - begin) / 1e9,
                "transitions": made,
                "adherence": made / allowed,
            }
        )
    return found


def draw(path: Path, outcome: Outcome, found: list[dict[str, Any]], title: str) -> None:
    """Save the picture of the walk, with what :func:`phases` found, at least one."""
    from rmll_view.frequency import Share, frequency_figure

    rows = _walk(outcome)
    shares, start = [], 0.0
    for phase in found:
        end = start + phase["seconds"]
        text = f"c_f {phase['frequency']:g}\nadherence {phase['adherence']:.2f}"
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


def _walk(outcome: Outcome) -> list[dict[str, Any]]:
    """The log's rows of walking, without the halt."""
    start, end = outcome.report["walking_start_ns"], outcome.report["walking_end_ns"]
    if start is None:
        return []
    return [r for r in outcome.log if start <= r["t_ns"] <= end and r["mode"] == "walking"]
