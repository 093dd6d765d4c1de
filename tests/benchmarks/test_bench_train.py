"""The trainer's side: how much of the time of learning is bare physics.

``test_learning`` counts a rollout of 1024 robots and its update. Within the same rounds it
adds up what ``Batch.step`` takes of them: their ratio, and both speeds, are printed and kept with
the benchmark. ``test_bare_batch_step`` is the same call on robots that stand.
"""

import time
from dataclasses import replace

import pytest

import rmll_train  # isort: skip  # noqa: F401 - before torch: how OpenMP's threads wait
import torch
from mujoco.batch import Batch

from rmll_gaits.load import load_gait
from rmll_robots import A1
from rmll_train.env.environment import GaitEnv
from rmll_train.env.simulation import training_model
from rmll_train.learning.gait_ppo import GaitPPO
from rmll_train.learning.precision import choose
from rmll_train.train_settings import TrainSettings

SETTINGS = TrainSettings()
LEARNER = replace(SETTINGS.learner, bf16=choose(SETTINGS).bf16)
ENVS, ROLLOUT = SETTINGS.world.envs, SETTINGS.learner.rollout


class Stopwatch:
    """Stands in front of a Batch and adds up the time of its steps [s]."""

    def __init__(self, batch: Batch):
        self._batch, self.total = batch, 0.0

    def step(self, nstep: int) -> None:
        began = time.perf_counter()
        try:
            self._batch.step(nstep=nstep)
        finally:
            self.total += time.perf_counter() - began

    def __getattr__(self, name: str):
        return getattr(self._batch, name)


@pytest.fixture
def env() -> GaitEnv:
    env = GaitEnv(load_gait("trot"), A1, SETTINGS.world, 0)
    env.demands.progress = 1.0  # as for most of a run: robots at their full weight touch more
    return env


def test_bare_batch_step(benchmark) -> None:
    batch = Batch(training_model(A1), ENVS)
    batch.reset(keyframe=0)
    control = batch.bind("ctrl")
    control[:] = A1.default_pose
    benchmark.pedantic(batch.step, kwargs={"nstep": 4}, rounds=50, warmup_rounds=5)


def test_environment_step(benchmark, env: GaitEnv) -> None:
    action = 0.3 * torch.randn(ENVS, 12)
    benchmark.pedantic(env.step, (action,), rounds=50, warmup_rounds=5)


def test_learning(benchmark, env: GaitEnv) -> None:
    learner, simulation = GaitPPO(env, LEARNER), env.simulation
    stopwatch = simulation._batch = Stopwatch(simulation._batch)
    learner.learn(env)
    stopwatch.total = 0.0
    rounds = 20
    benchmark.pedantic(learner.learn, (env,), rounds=rounds)
    total, steps = sum(benchmark.stats.stats.data), rounds * ROLLOUT * ENVS
    figures = {
        "environment_steps_per_second": round(steps / total),
        "bare_environment_steps_per_second": round(steps / stopwatch.total),
        "physics_steps_per_second": round(steps * simulation.substeps / stopwatch.total),
        "ratio": round(stopwatch.total / total, 3),
    }
    benchmark.extra_info |= figures
    print("\n" + "  ".join(f"{name} {value:,}" for name, value in figures.items()))
