"""Which foot was down when: the paper's foot-contact diagram, expected or measured."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from rmll_gaits.label import FEET
from rmll_gaits.pose import BITS, PAPER_FEET
from rmll_gaits.schedule import POLICY_HZ, main_cycle
from rmll_gaits.table import MachineTable
from rmll_view.expected import DOWN, EITHER, at_odds, expected
from rmll_view.palette import FOOT_COLOURS, HIGHLIGHT, INK, MUTED, PAPER, REJECT, state_colour

Times = NDArray[np.float64]
Span = tuple[float, float]
"""From and to [s]"""

PALE = 0.5
"""Opacity of what is expected"""
_COLUMN = {name: BITS[name].bit_length() - 1 for name in PAPER_FEET}


def draw_contacts(
    axes: Axes, times: Times, down: NDArray[np.bool_], *, highlight: Span | None = None
) -> None:
    """Draw a bar per foot wherever it is in contact.

    Args:
        times: (T,) [s], rising, T at least 1; each sample lasts until the next.
        down: (T, 4) in contact, feet in the order of ``rmll_gaits.label.FEET``.
        highlight: a stretch to set off, such as one cycle.
    """
    if down.shape != (len(times), len(FEET)):
        raise ValueError(f"down has shape {down.shape}, expected {(len(times), len(FEET))}")
    for row, name in enumerate(PAPER_FEET):
        shown = down[:, _COLUMN[name]]
        _bars(axes, times, shown, (row - 0.36, 0.72), color=FOOT_COLOURS[name], linewidth=0)
    axes.set_yticks(range(len(PAPER_FEET)), PAPER_FEET)
    axes.set_ylim(len(PAPER_FEET) - 0.5, -0.5)
    _finish(axes, times, highlight)


def draw_comparison(
    axes: Axes,
    times: Times,
    down: NDArray[np.bool_],
    states: NDArray[np.int64],
    off_spec: NDArray[np.bool_],
    table: MachineTable,
    *,
    highlight: Span | None = None,
) -> None:
    """Draw per foot what the automaton expects, thin and pale, above what was measured.

    Steps that are ``off_spec`` (T,) are red across both, and the feet that make them so: filled
    where one is down that should not be, hollow where one is missing. Thin and hollow is a foot
    that may be down. Other arguments as in :func:`draw_contacts` and :func:`draw_states`.
    """
    pose, wrong = expected(states, table), at_odds(states, down, off_spec, table)
    for start, end, odd in _runs(times, off_spec):
        if odd:
            axes.axvspan(start, end, color=REJECT, alpha=0.13, linewidth=0, zorder=0.5)
    for row, name in enumerate(PAPER_FEET):
        foot, colour = _COLUMN[name], FOOT_COLOURS[name]
        thin, thick = (row - 0.40, 0.16), (row - 0.20, 0.58)
        touching, odd = down[:, foot], wrong[:, foot]
        _bars(axes, times, pose[:, foot] == DOWN, thin, color=colour, alpha=PALE, linewidth=0)
        _bars(axes, times, pose[:, foot] == EITHER, thin, edgecolor=colour, facecolor=PAPER)
        _bars(axes, times, touching, thick, color=colour, linewidth=0)
        _bars(axes, times, touching & odd, thick, color=REJECT, linewidth=0)
        _bars(axes, times, ~touching & odd, thick, edgecolor=REJECT, facecolor=PAPER)
    axes.set_yticks(range(len(PAPER_FEET)), PAPER_FEET)
    axes.set_ylim(len(PAPER_FEET) - 0.5, -0.5)
    _finish(axes, times, highlight)


def _legend(either: bool) -> list[Patch]:
    return [
        Patch(color=MUTED, alpha=PALE, label="expected in this state", linewidth=0),
        *([Patch(edgecolor=MUTED, facecolor=PAPER, label="may be down")] if either else []),
        Patch(color=MUTED, label="measured", linewidth=0),
        Patch(color=REJECT, label="off-spec: a foot too many", linewidth=0),
        Patch(edgecolor=REJECT, facecolor=PAPER, label="off-spec: a foot missing"),
    ]


def _bars(
    axes: Axes, times: Times, shown: NDArray[np.bool_], rows: tuple[float, float], **style: Any
) -> None:
    """Bars wherever ``shown``, from and height in ``rows``."""
    bars = [(start, end - start) for start, end, value in _runs(times, shown) if value]
    axes.broken_barh(bars, rows, **style)


def draw_states(
    axes: Axes, times: Times, states: NDArray[np.int64], names: tuple[str, ...]
) -> None:
    """Draw the automaton's state, (T,) indices into ``names``, as a ribbon."""
    total = _end(times) - times[0]
    for start, end, state in _runs(times, states):
        axes.broken_barh([(start, end - start)], (-0.5, 1), color=state_colour(int(state)))
        if end - start > total / 60:
            middle = (start + end) / 2
            axes.text(middle, 0, names[int(state)], ha="center", va="center", size=8, color=INK,
                      clip_on=True)  # fmt: skip
    axes.set_yticks([0], ["state"])
    axes.set_ylim(-0.5, 0.5)
    _finish(axes, times, None)


def contact_figure(
    path: Path,
    times: Times,
    down: NDArray[np.bool_],
    states: NDArray[np.int64],
    table: MachineTable,
    off_spec: NDArray[np.bool_],
    title: str,
    *,
    window: float = 3.0,
) -> None:
    """Save contacts, expected and measured, and states as a picture, one full cycle set off.

    Shown are ``window`` seconds around the full cycle nearest to the middle of the log. Arrays
    as in :func:`draw_comparison` and :func:`draw_states`, T at least 1. The picture's format
    follows from the suffix of ``path``.
    """
    cycle = find_cycle(times, states, table)
    middle = sum(cycle) / 2 if cycle else (times[0] + times[-1]) / 2
    shown = np.abs(times - middle) <= window / 2
    times, down, states, off_spec = times[shown], down[shown], states[shown], off_spec[shown]
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(7, 1))
    if cycle:
        title += f"; a cycle takes {cycle[1] - cycle[0]:.2f} s"
    figure.suptitle(title, parse_math=False)
    draw_comparison(upper, times, down, states, off_spec, table, highlight=cycle)
    draw_states(lower, times, states, table.states)
    lower.set_xlabel("time [s]")
    either = bool((expected(states, table) == EITHER).any())
    figure.legend(handles=_legend(either), loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(path, dpi=150)


def find_cycle(times: Times, states: NDArray[np.int64], table: MachineTable) -> Span | None:
    """A full round of the gait's main cycle near the middle of a log; None without one.

    Args:
        times: (T,) [s].
        states: (T,) states of the automaton.
    """
    middle = (times[0] + times[-1]) / 2
    rounds = full_cycles(times, states, table)
    return min(rounds, key=lambda span: abs(sum(span) / 2 - middle), default=None)


def full_cycles(times: Times, states: NDArray[np.int64], table: MachineTable) -> list[Span]:
    """All full rounds of the gait's main cycle; arguments as in :func:`find_cycle`."""
    wanted = [phase.state for phase in main_cycle(table)]
    runs = _runs(times, states)[1:]  # the log may begin in the midst of the first
    visited = [state for _, _, state in runs]
    length = len(wanted)
    return [
        (runs[i][0], runs[i + length - 1][1])
        for i in range(len(runs) - length)
        if visited[i : i + length] == wanted
    ]


def _runs(times: Times, values: NDArray) -> list[tuple[float, float, int]]:
    """Stretches of equal values as (from, to, value)."""
    changes = np.flatnonzero(np.diff(values)) + 1
    edges = [times[0], *times[changes], _end(times)]
    held = [int(values[i]) for i in (0, *changes)]
    return [(float(a), float(b), v) for (a, b), v in zip(pairwise(edges), held, strict=True)]


def _end(times: Times) -> float:
    """When the last sample is over: it lasts as long as the one before, or a policy step."""
    return float(times[-1] + (times[-1] - times[-2] if len(times) > 1 else 1 / POLICY_HZ))


def _finish(axes: Axes, times: Times, highlight: Span | None) -> None:
    if highlight:
        axes.axvspan(*highlight, color=HIGHLIGHT, zorder=0)
        for edge in highlight:
            axes.axvline(edge, color=INK, linestyle="--", linewidth=1)
    axes.set_xlim(times[0], _end(times))
    axes.tick_params(length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
