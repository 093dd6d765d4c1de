"""Where a policy comes from: the code, the seed and the settings that made it."""

import subprocess
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import NotRequired, TypedDict

import msgspec

from rmll_gaits.table import MachineTable
from rmll_train.train_settings import PlainSettings, TrainSettings


class RunOrigin(TypedDict):
    """With what a run began, or goes on."""

    trained_by: str
    commit: str
    seed: int
    torch: str
    mujoco: str
    settings: PlainSettings


class Stage(TypedDict):
    """What a run did up to some step with other code or settings."""

    steps: int
    commit: str
    settings: PlainSettings


class Provenance(RunOrigin):
    """How far a run came, and how good its policy is if it has finished."""

    steps: int
    minutes: float
    failed_simulations: int
    skipped_steps: int
    stages: list[Stage]
    metrics: NotRequired[dict[str, float]]
    measured: NotRequired[str]
    """In words, in which world"""
    useful: NotRequired[bool]
    shortfalls: NotRequired[list[str]]
    limits: NotRequired[list[str]]


def origin(settings: TrainSettings, gait: MachineTable) -> RunOrigin:
    """Plain values; to be asked for when a run begins, for the code may change while it trains.

    The gait is told by its name: where its file lay is nobody's business, and its rules are in the
    contract.
    """
    return {
        "trained_by": f"rmll {version('rmll')}",
        "commit": _commit(),
        "seed": settings.seed,
        "torch": version("torch"),
        "mujoco": version("mujoco"),
        "settings": msgspec.to_builtins(settings) | {"gait": gait.gait},
    }


def stages(before: Provenance, now: RunOrigin) -> list[Stage]:
    """What a run did with other code or settings than ``now``, oldest first.

    ``before`` is the provenance that it had when it stopped, ``now`` the :func:`origin` with which
    it goes on. Each stage tells up to which step it went. More steps alone make no new stage, nor
    does a processor that is faster with other products.
    """
    if before["commit"] == now["commit"] and _lasting(before) == _lasting(now):
        return before["stages"]
    over = Stage(steps=before["steps"], commit=before["commit"], settings=before["settings"])
    return [*before["stages"], over]


def _lasting(origin: RunOrigin) -> Mapping[str, object]:
    settings = origin["settings"]
    return {**settings, "learner": settings["learner"] | {"steps": None, "bf16": None}}


def _commit() -> str:
    """Commit of the source tree, with "+" if it was changed since; "unknown" outside git."""
    here = Path(__file__).parent
    call = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--dirty=+"]
    try:
        return subprocess.run(call, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
