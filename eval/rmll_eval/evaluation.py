"""All walks of one policy in one world, and what they come to."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from rmll_eval.conditions import Conditions
from rmll_eval.evaluation_report import (
    EvaluationReport,
    MeanAndWorst,
    PaperComparison,
    WalkRecord,
)
from rmll_eval.paper_reference import FLAT, Reference
from rmll_eval.walk_metrics import ENERGY, METRICS, WalkMetrics, fallen, faulted, mean, stuck, worst

_WORLDS = {"emulator": "in the emulator", "trainer": "in the trainer's world"}


@dataclass(frozen=True)
class Evaluation:
    """Walks of equal length, over a grid of commands or with drawn ones."""

    gait: str
    policy: str
    """File that it comes from"""
    world: str
    """emulator or trainer"""
    seconds: float
    """of each walk"""
    seed: int
    conditions: Conditions
    walks: Sequence[WalkMetrics]

    @property
    def title(self) -> str:
        count = len(self.walks)
        plural = "s" if count > 1 else ""
        return (
            f"{self.gait} {_WORLDS[self.world]}{self.conditions.title}: {count} walk{plural} of "
            f"{self.seconds:g} s, {fallen(self.walks)} with a fall"
        )

    @property
    def reference(self) -> Reference | None:
        """The paper's energy of this gait on flat ground, None on other ground and for a gait that
        it does not have."""
        return FLAT.get(self.gait) if self.conditions.ground == "flat" else None

    def at_the_papers_speeds(self) -> list[WalkMetrics]:
        """Walks with a speed at which the paper measured this gait's energy."""
        if self.reference is None:
            return []
        low, high = self.reference.vx
        return [walk for walk in self.walks if low <= walk.trial.vx <= high]

    def axes(self) -> tuple[list[float], list[float]]:
        """Speeds and frequencies of a grid's walks, rising."""
        trials = [walk.trial for walk in self.walks]
        return sorted({t.vx for t in trials}), sorted({t.frequency for t in trials})

    def cell(self, vx: float, frequency: float) -> list[WalkMetrics]:
        """The walks of a grid with this command."""
        wanted = vx, frequency
        return [walk for walk in self.walks if (walk.trial.vx, walk.trial.frequency) == wanted]

    def report(self) -> EvaluationReport:
        """Mean and worst of every metric, the paper's energy, and each walk."""
        walks = self.walks
        return EvaluationReport(
            gait=self.gait,
            policy=self.policy,
            world=self.world,
            seconds=self.seconds,
            seed=self.seed,
            ground=self.conditions.ground,
            level=self.conditions.level,
            pushes=self.conditions.pushes,
            episodes=len(walks),
            falls=fallen(walks),
            faults=faulted(walks),
            stuck=stuck(walks),
            **{m.name: MeanAndWorst(mean(m, walks), worst(m, walks)) for m in METRICS},
            energy_at_the_papers_speeds=self._comparison(),
            walks=tuple(map(_flat, walks)),
        )

    def _comparison(self) -> PaperComparison | None:
        if (reference := self.reference) is None:
            return None
        compared = self.at_the_papers_speeds()
        return PaperComparison(
            vx=reference.vx,
            episodes=len(compared),
            energy_per_metre=mean(ENERGY, compared),
            paper=reference.energy_per_metre,
        )


def _flat(walk: WalkMetrics) -> WalkRecord:
    plain = asdict(walk)
    return WalkRecord(**plain.pop("trial"), **plain)
