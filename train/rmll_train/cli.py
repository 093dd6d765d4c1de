"""The ``rmll-train`` command."""

import sys
import time
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Literal

import yaml
from rich.console import Console
from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from rmll_contract import command
from rmll_gaits.errors import InputError
from rmll_gaits.load import load_gait
from rmll_train import settings as settings_file
from rmll_train.settings import Settings
from rmll_train.training import RESULT, SETTINGS, Progress, train


def main() -> None:
    command.run("rmll-train", _train)


def _train(
    gait: str = "",
    preset: Literal["default", "paper"] = "default",
    settings: Path | None = None,
    steps: int | None = None,
    envs: int | None = None,
    seed: int | None = None,
    runs: Path = Path("runs"),
    resume: Path | None = None,
) -> int:
    """Train a gait's policy.

    Example: rmll-train --gait trot --steps 12000000
    Ctrl-C stops after the current update; go on with: rmll-train --resume runs/trot/NAME

    Args:
        gait: a gait of the library, or a gait file.
        preset: "paper" turns off everything that the paper does not have.
        settings: YAML file with the settings that differ from the preset.
        steps: environment steps in all.
        envs: simulated robots.
        seed: of the networks, the robots and the commands.
        runs: the run's folder is made in here, as GAIT/TIME-seedN.
        resume: folder of a run to go on with. With --settings, what that file names changes from
            here on; the policy's provenance then tells of both stages.
    """
    if resume is not None:
        if gait or envs or seed is not None or preset != "default":
            raise InputError("--resume takes the run's own settings, under --settings and --steps")
        chosen, folder = _continued(resume, settings), resume
    else:
        if not gait and settings is None:
            raise InputError("name a gait: --gait trot")
        chosen = _chosen(gait, preset, settings, envs, seed)
        name = f"{datetime.now():%Y%m%d-%H%M%S}-seed{chosen.seed}"
        folder = runs / load_gait(chosen.gait).gait / name
    if steps is not None:
        chosen = replace(chosen, learner=replace(chosen.learner, steps=steps))
    chosen.check()

    with _reporter() as report:
        finished = train(folder, chosen, report, resume=resume is not None)
    if not finished:
        print(f"stopped; go on with: rmll-train --resume {folder}")
        return 130
    metrics = yaml.safe_load((folder / RESULT).read_text())["metrics"]
    shown = ("adherence", "vx_error", "wz_error")
    figures = ", ".join(f"{name} {metrics[name]:.3f}" for name in shown)
    print(f"finished: {folder} ({figures}); export with: rmll-export --gait {folder.parent.name}")
    return 0


def _chosen(
    gait: str, preset: str, overlay: Path | None, envs: int | None, seed: int | None
) -> Settings:
    """The preset, under the settings file, under the flags."""
    chosen = settings_file.paper(Settings()) if preset == "paper" else Settings()
    if overlay is not None:
        chosen = settings_file.load(overlay, chosen)
    world = chosen.world if envs is None else replace(chosen.world, envs=envs)
    seed = chosen.seed if seed is None else seed
    return replace(chosen, gait=gait or chosen.gait, seed=seed, world=world)


def _continued(run: Path, overlay: Path | None) -> Settings:
    """The run's settings, under the settings file."""
    before = settings_file.load(_existing(run / SETTINGS), Settings())
    chosen = before if overlay is None else settings_file.load(overlay, before)
    if (chosen.gait, chosen.seed) != (before.gait, before.seed):
        raise InputError(f"{overlay}: a run cannot change its gait or seed")
    return chosen


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file; --resume takes the folder of a run")
    return path


class _reporter:
    """One live progress line; without a terminal, a plain line every half minute."""

    def __enter__(self):
        console = Console(stderr=True)
        self._live = console.is_terminal
        self._last = time.monotonic()
        self._bar = Bar(
            BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"),
            TimeRemainingColumn(), console=console, disable=not self._live,
        )  # fmt: skip
        self._task = self._bar.add_task("starting")
        self._bar.start()
        return self._report

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def _report(self, progress: Progress) -> None:
        metrics = progress.metrics
        line = (
            f"{progress.steps / 1e6:.2f} M steps  {progress.rate:,.0f}/s  "
            f"adherence {metrics['adherence']:.2f}  vx error {metrics['vx_error']:.2f}  "
            f"wz error {metrics['wz_error']:.2f}  {metrics['energy_per_metre']:.0f} J/m"
        )
        self._bar.update(self._task, description=line, total=progress.total,
                         completed=progress.steps)  # fmt: skip
        if not self._live and time.monotonic() - self._last > 30:
            self._last = time.monotonic()
            left = (progress.total - progress.steps) / max(progress.rate, 1)
            print(f"{line}  {left / 60:.0f} min left", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
