"""Walks through the real daemon in the emulator, several at a time."""

import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from rmll_eval.trial import Trial
from rmll_eval.walk import Walk
from rmll_hil import lockstep
from rmll_hil.emulator import Emulator, Settings
from rmll_hil.metrics import summary
from rmll_onboard.bundle import load_bundle
from rmll_onboard.pilot import FlagPilot


def walks(bundle: Path, trials: Sequence[Trial], seconds: float, jobs: int) -> Iterator[Walk]:
    """The walks of ``trials`` in their order, as they come, ``jobs`` at a time.

    Each is a world of its own with its own seed, so the number of jobs changes nothing else.
    """
    if jobs == 1:
        yield from map(partial(walk, bundle, seconds), trials)
        return
    # spawned, for a fork would copy the threads of onnxruntime in an undefined state
    with ProcessPoolExecutor(jobs, get_context("spawn"), _leave_stopping_to_the_parent) as pool:
        yield from pool.map(partial(walk, bundle, seconds), trials)


def walk(bundle: Path, seconds: float, trial: Trial) -> Walk:
    """Stand up, walk for ``seconds``, sit down."""
    loaded = load_bundle(bundle)
    emulator = Emulator(Settings(seed=trial.seed), robot=loaded.robot)
    pilot = FlagPilot(loaded.table.commands, trial.vx, trial.wz, trial.frequency, seconds)
    outcome = lockstep.walk(emulator, loaded, pilot, lambda _: None)
    found = summary(outcome, loaded.contract.gait, loaded.robot)
    return Walk(trial, **{name: found[name] for name in Walk.__dataclass_fields__ if name in found})


def _leave_stopping_to_the_parent() -> None:
    """Ctrl-C reaches every process of the terminal; one message is enough."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
