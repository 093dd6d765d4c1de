"""``rmll-eval gait``: a policy over the commands it was trained for, in one of two worlds."""

import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from json import dumps
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tyro
from rich.progress import MofNCompleteColumn, TimeRemainingColumn

from rmll_common.errors import InputError
from rmll_common.flag import within
from rmll_common.optional_import import needs
from rmll_common.output_file import output_file
from rmll_eval import emulated, evaluated_policy
from rmll_eval.conditions import Conditions
from rmll_eval.evaluation import Evaluation
from rmll_eval.evaluation_case import EvaluationCase, draw, grid
from rmll_eval.picture import picture
from rmll_eval.tables import show
from rmll_eval.walk_metrics import WalkMetrics
from rmll_hil.runs import run_folder
from rmll_onboard.commands.operator import SECONDS
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import prove
from rmll_view.console import bar

World = Literal["emulator", "trainer"]
GRID_SECONDS, EPISODE_SECONDS = 6.0, 20.0
SEEDS = (1 << 32) - 1
"""The largest that both worlds take"""


def gait(
    name: Annotated[str, tyro.conf.Positional],
    *,
    world: World = "emulator",
    conditions: Annotated[Conditions, tyro.conf.OmitArgPrefixes] = Conditions(),  # noqa: B008 - frozen
    speeds: tuple[float, ...] = (),
    frequencies: tuple[float, ...] = (),
    repeats: int = 1,
    episodes: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    run: bool = False,
    runs: Path = Path("runs"),
    policies: Path = Path("policies"),
    jobs: int | None = None,
    json: bool = False,
    out: Path | None = None,
) -> None:
    """Measure how well a policy keeps its gait and follows its commands, and what it costs.

    Straight walks over a grid of speeds and frequencies, with heat maps; or, with --episodes,
    walks with random commands, turns among them. They go through the daemon's own code in the
    emulator, or through the trainer's world (needs torch).

    Example: rmll-eval gait trot --episodes 20 --ground rough --level 5 --pushes

    Args:
        name: A gait (a name or a gait file), a bundle (.onnx) or a checkpoint (.safetensors).
        world: "emulator" is nearest to the robot; "trainer" has the noise and robots of
            training, and counts every early end of an episode as a fall.
        conditions: What makes walking harder.
        speeds: Forward speeds of the grid [m/s]; 9 over the gait's range by default.
        frequencies: c_f of the grid [policy steps]; each whole one of the gait's by default.
        repeats: Walks in each cell of the grid.
        episodes: Walk that often with random commands instead of over the grid.
        seconds: Length of a walk; 6 on the grid, 20 with --episodes by default.
        seed: Of the commands and the worlds.
        run: Take the newest finished run of the gait's rules instead of the shipped policy.
        runs: Where rmll-train puts its runs.
        policies: Where the shipped bundles are.
        jobs: Emulators at a time; as many as there are processors by default.
        json: Print one JSON object.
        out: Picture of the grid to write, or a folder for it; a new file in hil-runs/ by default.
    """
    as_grid = episodes is None
    if seconds is None:
        seconds = GRID_SECONDS if as_grid else EPISODE_SECONDS
    if jobs is None:
        jobs = os.cpu_count() or 1
    within("repeats", repeats, 1, 1000)
    within("episodes", 1 if as_grid else episodes, 1, 100_000)
    within("seconds", seconds, 2, SECONDS[1])
    within("seed", seed, 0, SEEDS)
    within("jobs", jobs, 1, 1024)
    if not as_grid and (speeds or frequencies or out or repeats != 1):
        raise InputError("--episodes draws commands: it has no grid to shape, repeat or picture")
    emulated.settings(conditions, seed)
    out = out and output_file("--out", out, "grid.png", ".png")
    with tempfile.TemporaryDirectory(prefix="rmll-eval-") as scratch:
        found = evaluated_policy.find(name, run, runs, policies, Path(scratch))
        if found.told:
            print(found.told, file=sys.stderr)
        bundle = load_bundle(found.bundle)
        prove(bundle)
        commands = bundle.table.commands
        if episodes is None:
            trials = grid(commands, speeds, frequencies, repeats, seed)
        else:
            trials = draw(commands, episodes, seed)
        walks = list(
            _followed(_walks(world, found.bundle, trials, seconds, conditions, jobs), len(trials))
        )
    evaluation = Evaluation(
        bundle.contract.gait, str(found.source), world, seconds, seed, conditions, walks
    )
    if json:
        print(dumps(msgspec.to_builtins(evaluation.report())))
    else:
        show(evaluation, as_grid)
    if as_grid:
        target = out or run_folder.folder(None, f"{evaluation.gait}-grid") / "grid.png"
        picture(evaluation).savefig(target, dpi=150)
        print(target, file=sys.stderr)


def _walks(
    world: World,
    bundle: Path,
    trials: Sequence[EvaluationCase],
    seconds: float,
    conditions: Conditions,
    jobs: int,
) -> Iterator[WalkMetrics]:
    if world == "emulator":
        return emulated.walks(bundle, trials, seconds, conditions, jobs)
    with needs("--world trainer", "train"):
        from rmll_eval import trained
    return trained.walks(bundle, trials, seconds, conditions)


def _followed(walks: Iterable[WalkMetrics], total: int) -> Iterator[WalkMetrics]:
    """The same walks, with a bar on stderr."""
    with bar(MofNCompleteColumn(), TimeRemainingColumn()) as progress:
        yield from progress.track(walks, total=total, description="walks")
