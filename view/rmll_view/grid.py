"""Figures of a gait over speed and frequency, as heat maps side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from rmll_view.palette import INK, MUTED, PAPER, REJECT


@dataclass(frozen=True)
class Panel:
    """One heat map."""

    title: str
    values: NDArray[np.float64]
    """(speeds, frequencies), NaN where there is nothing to show"""
    limits: tuple[float, float]
    """Values at the ends of the colours"""
    better: Literal["high", "low"]
    """Which of the two ends is the pale one, so that trouble stands out dark in every panel"""
    decimals: int


def grid_figure(
    speeds: Sequence[float],
    frequencies: Sequence[float],
    panels: Sequence[Panel],
    fallen: NDArray[np.bool_],
    title: str,
) -> Figure:
    """The panels over c_f (to the right) and speed (upwards).

    Args:
        speeds: [m/s], rising.
        frequencies: c_f [policy steps], rising.
        panels: one heat map each.
        fallen: (speeds, frequencies), where the robot fell; these cells are marked.
        title: over all of them.
    """
    width, height = 1.6 + 0.5 * len(frequencies), 1.7 + 0.36 * len(speeds)
    figure = Figure(figsize=(len(panels) * width, height), layout="constrained")
    figure.suptitle(title, parse_math=False)
    for axes, panel in zip(
        np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True
    ):
        _draw(axes, panel, fallen)
        axes.set_xticks(range(len(frequencies)), [f"{n:g}" for n in frequencies])
        axes.set_xlabel("c_f [policy steps]", parse_math=False)
    first = figure.axes[0]
    first.set_yticks(range(len(speeds)), [f"{v:g}" for v in speeds])
    first.set_ylabel("commanded speed [m/s]")
    if fallen.any():
        figure.text(1, 0, "red: fell ", color=REJECT, ha="right", va="bottom", size=8)
    return figure


def _draw(axes: Axes, panel: Panel, fallen: NDArray[np.bool_]) -> None:
    colours = colormaps["YlGnBu_r" if panel.better == "high" else "YlGnBu"]
    scale = Normalize(*panel.limits, clip=True)
    axes.set_facecolor(PAPER)
    shown = np.ma.masked_invalid(panel.values)
    axes.imshow(shown, cmap=colours, norm=scale, origin="lower", aspect="auto")
    for (row, column), value in np.ndenumerate(panel.values):
        if np.isnan(value):
            axes.text(column, row, "-", ha="center", va="center", size=8, color=MUTED)
            continue
        red, green, blue, _ = colours(scale(value))
        ink = PAPER if 0.3 * red + 0.6 * green + 0.1 * blue < 0.5 else INK
        axes.text(column, row, f"{value:.{panel.decimals}f}", ha="center", va="center", size=8,
                  color=ink)  # fmt: skip
    for row, column in np.argwhere(fallen):
        corner = (column - 0.45, row - 0.45)
        axes.add_patch(Rectangle(corner, 0.9, 0.9, fill=False, edgecolor=REJECT, linewidth=1.5))
    axes.set_title(panel.title, size=10, parse_math=False)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
