"""An evaluation over a grid as heat maps."""

import numpy as np
from matplotlib.figure import Figure

from rmll_eval.evaluation import Evaluation
from rmll_eval.walk_metrics import ADHERENCE, ENERGY, VX_ERROR, Metric, fallen, mean
from rmll_view.grid import Panel, grid_figure

_PANELS = ((ADHERENCE, (0.5, 1.0)), (VX_ERROR, (0.0, 0.4)), (ENERGY, (0.0, 300.0)))
"""Metrics and the ends of their colours: the same for all gaits, so that pictures compare"""


def picture(evaluation: Evaluation) -> Figure:
    """Adherence, speed error and energy over speed and frequency."""
    speeds, frequencies = evaluation.axes()
    cells = [[evaluation.cell(vx, n) for n in frequencies] for vx in speeds]
    panels = [
        Panel(
            title=_title(metric, evaluation),
            # None becomes NaN
            values=np.array([[mean(metric, cell) for cell in row] for row in cells], float),
            limits=limits,
            better="high" if metric.worst is min else "low",
            decimals=metric.decimals,
        )
        for metric, limits in _PANELS
    ]
    down = np.array([[fallen(cell) > 0 for cell in row] for row in cells])
    return grid_figure(speeds, frequencies, panels, down, evaluation.title)


def _title(metric: Metric, evaluation: Evaluation) -> str:
    reference = evaluation.reference
    if metric is not ENERGY or reference is None:
        return metric.title
    low, high = reference.vx
    paper = f"the paper: {ENERGY.plain(reference.energy_per_metre)} at {low:g} to {high:g} m/s"
    return f"{metric.title}\n{paper}"
