"""How long gaits take to become useful: steps and minutes until a policy without exploration is.

    python -m rmll_train.time_to_gait --gaits trot walk --seeds 0 1 2
    python -m rmll_train.time_to_gait --gaits trot --seeds 0 --without all

Each run trains with default settings on flat ground. Every quarter of a million steps its policy is
judged (see ``evaluation.Judge``). A level is held when two judgements in a row reach it; the first
of them counts. Their time is left out of the minutes. Results are kept as lines of JSON, so that an
interrupted table goes on.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from rmll_common import command_line
from rmll_common.errors import InputError
from rmll_contract.usefulness import ADHERENCE
from rmll_gaits.load import load_gait
from rmll_train.periodic_evaluation import Judgement
from rmll_train.provenance import origin
from rmll_train.train_settings import TrainSettings, overlaid
from rmll_train.training import Run
from rmll_view.console import console

EVERY = 250_000
"""Environment steps between two judgements"""
LEVELS: dict[str, Callable[[Judgement], bool]] = {
    f"adherence {ADHERENCE}": lambda found: found.metrics["adherence"] >= ADHERENCE,
    "useful": lambda found: found.useful,
}
SIX = ("trot", "pace", "bound", "walk", "three_one", "half_bound")
WITHOUT: dict[str, dict[str, Any]] = {
    "": {},
    "reward_shaping": {"world": {"rewards": {"reward_shaping": "clip"}}},
    "dwell": {"world": {"rewards": {"bonus_source": "step"}}},
    "promptness": {"world": {"rewards": {"promptness": 0.0}}},
    "fine": {"world": {"rewards": {"fine_share": 0.0}}},
    "turning": {"world": {"rewards": {"velocity_yaw": 0.5}}},
    "cost_scale": {"world": {"rewards": {"cost_scale": [1.0, 1.0]}}},
    "lenience": {"world": {"rewards": {"strict_above_adherence": 0.0}}},
    "clearance": {"world": {"first_clearance": 0.03}},
    "gravity": {"world": {"first_gravity": 1.0}},
    "mistakes": {"world": {"on_violation": "end"}},
    "start": {"world": {"start": "first"}},
    "scale": {"learner": {"normalise_returns": False}},
    "symmetry": {"learner": {"symmetry": False}},
    "rates": {"learner": {"rate_range": [1e-5, 1e-2]}},
    "entropy": {"learner": {"entropy": [0.01, 0.01]}},
    "spread": {"learner": {"spread_rate": 1.0}},
    "epochs": {"learner": {"epochs": 5, "critic_epochs": 5}},
    "critic": {"learner": {"critic_epochs": 2}},
    "rollout": {"learner": {"rollout": 24}},
    "bf16": {"learner": {"bf16": False}},
}
"""What each departure from the paper is called, and the settings that turn it off"""


@dataclass(frozen=True)
class EvaluationPoint:
    """A judgement, and when in the run it was made."""

    steps: int
    minutes: float
    judgement: Judgement


@dataclass(frozen=True)
class Emergence:
    """One run's result; None for a level that it did not hold."""

    gait: str
    seed: int
    without: str
    commit: str
    bf16: bool
    steps: list[int | None]
    """environment steps, for each of ``LEVELS``"""
    minutes: list[float | None]
    adherence: float
    vx_error: float
    """[m/s]"""
    wz_error: float
    """[rad/s], these three at the end of the run"""
    rate: float
    """environment steps a second, learning included"""


def time_to_gait(
    gait: str, seed: int, without: str, limit: int, say: Callable[[str], None]
) -> Emergence:
    """Train until the gait is useful, or for ``limit`` steps."""
    settings = overlaid(replace(TrainSettings(), gait=gait, seed=seed), WITHOUT[without], without)
    table = load_gait(gait)
    run = Run(settings, table)
    judge = run.judge()
    seen: list[EvaluationPoint] = []
    while run.steps < limit and not held(seen, LEVELS["useful"]):
        run.update()
        if run.steps >= min(limit, EVERY * (len(seen) + 1)):
            seen.append(EvaluationPoint(run.steps, run.seconds / 60, judge(run.policy)))
            say(
                f"{gait} {without} seed {seed}: {run.steps / 1e6:.2f} M steps, {_figures(seen[-1])}"
            )
    marks = [held(seen, level) for level in LEVELS.values()]
    last = seen[-1].judgement.metrics
    return Emergence(
        gait, seed, without, origin(settings, table)["commit"], run.precision.bf16,
        steps=[mark and mark.steps for mark in marks],
        minutes=[mark and round(mark.minutes, 2) for mark in marks],
        adherence=round(last["adherence"], 3), vx_error=round(last["vx_error"], 3),
        wz_error=round(last["wz_error"], 3), rate=round(run.steps / run.seconds),
    )  # fmt: skip


def held(seen: list[EvaluationPoint], level: Callable[[Judgement], bool]) -> EvaluationPoint | None:
    """The first of two judgements in a row that reach ``level``."""
    for first, second in pairwise(seen):
        if level(first.judgement) and level(second.judgement):
            return first
    return None


def _figures(seen: EvaluationPoint) -> str:
    found = seen.judgement.metrics
    return (
        f"adherence {found['adherence']:.3f}, errors {found['vx_error']:.3f} m/s "
        f"{found['wz_error']:.3f} rad/s, {found['falls']:.0f} falls"
    )


def _table(results: list[Emergence]) -> Table:
    table = Table("gait", "seed", "without", box=None)
    for head in (*(f"{level} at [M steps]" for level in LEVELS),
                 *(f"{level} at [min]" for level in LEVELS),
                 "last: adherence, vx, wz error", "steps/s"):  # fmt: skip
        table.add_column(Text(head), justify="right")
    for found in results:
        millions = [_plain(steps and steps / 1e6) for steps in found.steps]
        minutes = [_plain(value) for value in found.minutes]
        last = f"{found.adherence:.3f}, {found.vx_error:.3f}, {found.wz_error:.3f}"
        table.add_row(found.gait, str(found.seed), found.without, *millions, *minutes, last,
                      f"{found.rate:,}")  # fmt: skip
    return table


def _plain(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def measure(
    gaits: tuple[str, ...] = SIX,
    seeds: tuple[int, ...] = (0, 1, 2),
    without: tuple[str, ...] = ("",),
    limit: int = 12_000_000,
    out: Path = Path("time-to-gait.jsonl"),
) -> None:
    """Measure how long gaits take to become useful, with default settings on flat ground.

    Example: python -m rmll_train.time_to_gait --gaits trot --seeds 0

    Args:
        gaits: names of the library, or gait files.
        seeds: one run each.
        without: departures from the paper to turn off, one a run; "all" for each of them in turn.
        limit: environment steps after which a run is given up.
        out: one line a run; runs that have their line are not repeated.
    """
    messages = console(stderr=True)
    lines = out.read_text().splitlines() if out.exists() else []
    try:
        results = [Emergence(**json.loads(line)) for line in lines]
    except (TypeError, ValueError) as error:
        raise InputError(f"{out}: not a table of this version: {error}") from error
    if unknown := set(without) - {"all", *WITHOUT}:
        raise InputError(f"--without {unknown.pop()}: known: all, {', '.join(WITHOUT)}")
    chosen = tuple(WITHOUT) if "all" in without else without
    for run in product(gaits, seeds, chosen):
        if not any((found.gait, found.seed, found.without) == run for found in results):
            results.append(time_to_gait(*run, limit, messages.print))
            with out.open("a") as file:
                file.write(json.dumps(asdict(results[-1])) + "\n")
    console().print(_table(results))


if __name__ == "__main__":
    command_line.run("rmll_train.time_to_gait", measure)
