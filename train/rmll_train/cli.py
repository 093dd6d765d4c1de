"""The ``rmll-train`` command."""

import re
import shlex
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
import yaml

from rmll_common import command_line
from rmll_common.errors import InputError
from rmll_gaits.load import library_names, load_gait
from rmll_train import train_settings as settings_file
from rmll_train.live_report import LiveReport
from rmll_train.recipe import is_recipe, load_recipe, located, train_stages
from rmll_train.train_settings import TrainSettings
from rmll_train.training import RESULT, SETTINGS


def main() -> None:
    command_line.run("rmll-train", _train)


def _train(
    name: Annotated[str, tyro.conf.Positional] = "",
    *,
    gait: str = "",
    preset: Literal["default", "paper"] = "default",
    settings: Path | None = None,
    steps: str | None = None,
    envs: int | None = None,
    seed: int | None = None,
    runs: Path | None = None,
    resume: Path | None = None,
) -> int:
    """Train a gait's policy.

    Example: rmll-train trot --steps 3M
    Ctrl-C stops after the current update; go on with: rmll-train --resume runs/trot/NAME
    A shipped policy again, stages and all: rmll-train experiments/walk.yaml

    Args:
        name: a gait of the library, a gait file, or a recipe. A recipe takes only --runs, and
            --resume to go on where a run of it stopped.
        gait: a gait of the library, or a gait file.
        preset: "paper" turns off everything that the paper does not have.
        settings: YAML file with the settings that differ from the preset.
        steps: environment steps in all, such as 3000000, 3e6 or 3M.
        envs: simulated robots.
        seed: of the networks, the robots and the commands.
        runs: the run's folder is made in here, as GAIT/TIME-seedN; runs/ by default.
        resume: folder of a run to go on with. With --settings, what that file names changes from
            here on; the policy's provenance then tells of both stages.
    """
    if name and gait:
        raise InputError(f"{name!r} and --gait {gait!r}: name one gait")
    if is_recipe(name):
        if settings or (preset, steps, envs, seed) != ("default", None, None, None):
            raise InputError(f"{name} is a recipe: it takes --runs or --resume alone")
        return _recipe(name, runs, resume)
    gait = gait or name
    if resume is not None:
        own = (envs, seed, runs) != (None, None, None) or preset != "default"
        if gait or own:
            raise InputError("--resume takes the run's own settings, under --settings and --steps")
        chosen = _continued(resume, settings)
    else:
        if not gait and settings is None:
            raise InputError(f"name a gait, such as {', '.join(library_names())}, or a gait file")
        chosen = _chosen(gait, preset, settings, envs, seed)
    if steps is not None:
        chosen = replace(chosen, learner=replace(chosen.learner, steps=count("steps", steps)))
    chosen.check()
    return _run([chosen], runs, resume)


def _recipe(name: str, runs: Path | None, resume: Path | None) -> int:
    stages = load_recipe(Path(name))
    if resume is not None:
        if runs is not None:
            raise InputError("--resume goes on in the run's own folder, without --runs")
        before = settings_file.load(_existing(resume / SETTINGS), TrainSettings())
        if (before.gait, before.seed) != (stages[0].gait, stages[0].seed):
            raise InputError(f"{resume} is no run of {name}: another gait or seed")
    return _run(stages, runs, resume, recipe=name)


def _run(
    stages: list[TrainSettings], runs: Path | None, resume: Path | None, recipe: str = ""
) -> int:
    """Train in a new folder within ``runs``, or go on in ``resume``; the exit status."""
    begun = f"{datetime.now():%Y%m%d-%H%M%S}-seed{stages[0].seed}"
    folder = resume or (runs or Path("runs")) / load_gait(stages[0].gait).gait / begun
    with LiveReport() as report:
        finished = train_stages(folder, stages, report, resume=resume is not None)
    if not finished:
        print(f"stopped; go on with: {_resume(folder, recipe)}")
        return 130
    print("\n".join(_summary(folder, yaml.safe_load((folder / RESULT).read_text()))))
    return 0


def _resume(folder: Path, recipe: str = "") -> str:
    words = ["rmll-train", *([recipe] if recipe else []), "--resume", str(folder)]
    return shlex.join(words)


def _summary(folder: Path, result: dict[str, Any]) -> list[str]:
    """A finished run in words: is it useful, and what would the robot's daemon say of it?"""
    metrics = result["metrics"]
    lines = [
        f"finished: {folder}",
        f"{result['measured']}:",
        f"  adherence {metrics['adherence']:.3f}, vx error {metrics['vx_error']:.3f} m/s, "
        f"wz error {metrics['wz_error']:.3f} rad/s, falls: {metrics['falls']:.0f}",
        f"  feet touch otherwise than the rules say {metrics['off_spec_contact']:.0%} of the time",
    ]
    if result["limits"]:
        lines += [
            "beyond what the robot's daemon allows:",
            *(f"  {one}" for one in result["limits"]),
        ]
    if result["useful"]:
        lines.append(f"useful; export with: rmll-export {shlex.quote(str(folder))}")
    else:
        lines += ["not useful yet:", *(f"  {text}" for text in result["shortfalls"])]
        steps = 2 * result["steps"]
        lines += ["go on with:", f"  {_resume(folder)} --steps {steps}"]
    return lines


def count(flag: str, text: str) -> int:
    """The whole number in ``3000000``, ``3_000_000``, ``3e6``, ``1.5M`` or ``200k``.

    Raises InputError, which names the flag, for anything else.
    """
    found = re.fullmatch(r"(\d[\d_]*(?:\.\d+)?(?:[eE]\+?\d)?)([kM]?)", text, re.ASCII)
    value = float(found[1]) * {"": 1, "k": 1e3, "M": 1e6}[found[2]] if found else 0.5
    if not value.is_integer():
        raise InputError(f"--{flag} {text}: expected a whole number, such as 3000000, 3e6 or 3M")
    return int(value)


def _chosen(
    gait: str, preset: str, overlay: Path | None, envs: int | None, seed: int | None
) -> TrainSettings:
    """The preset, under the settings file, under the flags."""
    chosen = settings_file.paper(TrainSettings()) if preset == "paper" else TrainSettings()
    if overlay is not None:
        chosen = settings_file.load(overlay, chosen)
    world = chosen.world if envs is None else replace(chosen.world, envs=envs)
    seed = chosen.seed if seed is None else seed
    return replace(chosen, gait=located(gait or chosen.gait), seed=seed, world=world)


def _continued(run: Path, overlay: Path | None) -> TrainSettings:
    """The run's settings, under the settings file."""
    before = settings_file.load(_existing(run / SETTINGS), TrainSettings())
    chosen = before if overlay is None else settings_file.load(overlay, before)
    if (chosen.gait, chosen.seed) != (before.gait, before.seed):
        raise InputError(f"{overlay}: a run cannot change its gait or seed")
    return chosen


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file; --resume takes the folder of a run")
    return path


if __name__ == "__main__":
    main()
