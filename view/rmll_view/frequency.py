"""A walk whose c_f changes: foot contacts, and beneath them the c_f asked for and the one kept."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rmll_view.contact_diagram import Times, draw_contacts
from rmll_view.palette import FOOT_COLOURS, INK, MUTED


class Share(NamedTuple):
    """A stretch of the walk with something to say about it."""

    start: float
    """[s]"""
    end: float
    text: str


def frequency_figure(
    path: Path,
    times: Times,
    down: NDArray[np.bool_],
    frequency: NDArray[np.float64],
    advanced: NDArray[np.bool_],
    shares: list[Share],
    title: str,
) -> None:
    """Save the picture; its format follows from the suffix of ``path``.

    Args:
        times: (T,) [s], rising, a sample each policy step.
        down: (T, 4) in contact, feet in the order of ``rmll_gaits.label.FEET``.
        frequency: (T,) c_f as the policy was told, policy steps.
        advanced: (T,) a transition was made in that step.
        shares: parts of the walk, each with a text.
    """
    figure = Figure(figsize=(12, 5), layout="constrained")
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(3, 2))
    figure.suptitle(title, parse_math=False)
    draw_contacts(upper, times, down)
    moments = np.flatnonzero(advanced)
    lower.plot(times[moments[1:]], np.diff(moments), ".", color=FOOT_COLOURS["FL"],
               label="policy steps from one transition to the next")  # fmt: skip
    lower.plot(times, frequency, color=FOOT_COLOURS["FR"], label="c_f, as the policy was told")
    top = float(frequency.max()) + 4
    for share in shares:
        for axes in (upper, lower):
            axes.axvline(share.end, color=MUTED, linestyle="--", linewidth=1)
        middle = (share.start + share.end) / 2
        lower.text(middle, top - 0.5, share.text, ha="center", va="top", size=9, color=INK)
    lower.set_ylim(0, top)
    lower.set_ylabel("policy steps")
    lower.set_xlabel("time [s]")
    lower.legend(loc="lower right", frameon=False, ncols=2)
    lower.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
