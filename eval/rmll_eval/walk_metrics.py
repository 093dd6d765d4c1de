"""What came of a trial, in the words of the project, and what many of them come to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rmll_eval.evaluation_case import EvaluationCase

LEAST_SPEED = 0.1
"""[m/s] A robot that is ordered to go more slowly mostly steps on the spot: its energy per metre
says nothing"""


@dataclass(frozen=True)
class WalkMetrics:
    """One walk. None where there was nothing to measure."""

    trial: EvaluationCase
    adherence: float | None
    off_spec_contact: float | None
    vx_error: float | None
    """[m/s]"""
    wz_error: float | None
    """[rad/s]"""
    energy_per_metre: float | None
    """[J/m]"""
    cost_of_transport: float | None
    distance: float
    """[m]"""
    falls: int
    fault: str | None = None
    stuck: bool = False
    """It stopped by itself, for its gait waited too long for a contact"""


@dataclass(frozen=True)
class Metric:
    """One figure of a walk, and how it is shown."""

    name: str
    unit: str
    decimals: int
    worst: Callable[..., float] = max

    @property
    def title(self) -> str:
        words = self.name.replace("_", " ")
        return f"{words} [{self.unit}]" if self.unit else words

    def plain(self, value: float | None) -> str:
        return "-" if value is None else f"{value:.{self.decimals}f}"


ADHERENCE = Metric("adherence", "", 2, min)
VX_ERROR = Metric("vx_error", "m/s", 2)
ENERGY = Metric("energy_per_metre", "J/m", 0)
METRICS = (
    ADHERENCE,
    Metric("off_spec_contact", "", 2),
    VX_ERROR,
    Metric("wz_error", "rad/s", 2),
    ENERGY,
    Metric("cost_of_transport", "", 2),
)


def values(metric: Metric, walks: Sequence[WalkMetrics]) -> list[tuple[float, float]]:
    """(value, weight) of the walks that have one.

    Energies weigh as much as the way they were spent on, so that their mean is all the energy over
    all the way, as in the paper; everything else counts once a walk.
    """
    over_distance = metric.name in ("energy_per_metre", "cost_of_transport")
    return [
        (value, walk.distance if over_distance else 1.0)
        for walk in walks
        if (value := getattr(walk, metric.name)) is not None
        and not (over_distance and abs(walk.trial.vx) < LEAST_SPEED)
    ]


def mean(metric: Metric, walks: Sequence[WalkMetrics]) -> float | None:
    """None without a value."""
    found = values(metric, walks)
    if not found:
        return None
    return sum(value * weight for value, weight in found) / sum(weight for _, weight in found)


def worst(metric: Metric, walks: Sequence[WalkMetrics]) -> float | None:
    """Of single walks; None without a value."""
    return metric.worst((value for value, _ in values(metric, walks)), default=None)


def fallen(walks: Sequence[WalkMetrics]) -> int:
    """Number of walks in which the robot fell."""
    return sum(walk.falls > 0 for walk in walks)


def stuck(walks: Sequence[WalkMetrics]) -> int:
    """Number of walks that the robot ended by itself, stuck in its gait."""
    return sum(walk.stuck for walk in walks)


def faulted(walks: Sequence[WalkMetrics]) -> int:
    """Number of walks that ended in a fault of the daemon, that of sitting down included."""
    return sum(walk.fault is not None for walk in walks)
