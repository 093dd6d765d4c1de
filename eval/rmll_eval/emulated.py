"""Walks through the real daemon in the emulator, several at a time."""

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from rmll_eval.conditions import Conditions, VelocityPush, pushes
from rmll_eval.evaluation_case import EvaluationCase
from rmll_eval.walk_metrics import WalkMetrics
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.world import World, push
from rmll_hil.runs import lockstep
from rmll_hil.runs.metrics import summary
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle


def walks(
    bundle: Path,
    trials: Sequence[EvaluationCase],
    seconds: float,
    conditions: Conditions,
    jobs: int,
) -> Iterator[WalkMetrics]:
    """The walks of ``trials`` in their order, as they come, ``jobs`` at a time.

    Each is a world of its own with its own seed, so the number of jobs changes nothing else.
    """
    walk_one = partial(walk, bundle, seconds, conditions)
    if jobs == 1:
        yield from map(walk_one, trials)
        return
    # spawned, for a fork would copy the threads of onnxruntime in an undefined state
    with ProcessPoolExecutor(jobs, get_context("spawn"), _leave_stopping_to_the_parent) as pool:
        yield from pool.map(walk_one, trials)


def settings(conditions: Conditions, seed: int) -> EmulatorSettings:
    """Of the emulated robot; raises InputError for a level that there is not."""
    chosen = EmulatorSettings(seed=seed, ground=conditions.ground, level=conditions.level)
    chosen.check()
    return chosen


def walk(
    bundle: Path, seconds: float, conditions: Conditions, trial: EvaluationCase
) -> WalkMetrics:
    """Stand up, walk for ``seconds``, sit down."""
    loaded = load_bundle(bundle)
    emulator = Emulator(settings(conditions, trial.seed), robot=loaded.robot)
    operator = FlagOperator(loaded.table.commands, trial.vx, trial.wz, trial.frequency, seconds)
    planned = pushes(trial.seed, seconds) if conditions.pushes else []
    outcome = lockstep.walk(emulator, loaded, operator, _pushing(emulator.world, planned))
    found = summary(outcome, loaded.contract.gait, loaded.robot)
    return WalkMetrics(
        trial,
        adherence=found.adherence,
        off_spec_contact=found.off_spec_contact,
        vx_error=found.vx_error,
        wz_error=found.wz_error,
        energy_per_metre=found.energy_per_metre,
        cost_of_transport=found.cost_of_transport,
        distance=found.distance,
        falls=found.falls,
        fault=found.fault,
        stuck=found.stuck,
    )


def _pushing(world: World, planned: list[VelocityPush]) -> Callable[[float], None]:
    """To be called with the robot's time [s] at each policy step; the first is walking's start."""
    start: float | None = None

    def step(now: float) -> None:
        nonlocal start
        start = now if start is None else start
        while planned and now - start >= planned[0].at:
            push(world, planned.pop(0).velocity)

    return step


def _leave_stopping_to_the_parent() -> None:
    """Ctrl-C reaches every process of the terminal; one message is enough."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
