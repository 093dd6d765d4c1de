"""The trainer's side: a policy step of 1024 robots, bare physics beside everything else.

``test_learning`` counts 24 policy steps and an update; divide by 24 to compare.
"""

import pytest
import torch
from mujoco.batch import Batch

from rmll_gaits.load import load_gait
from rmll_robots import A1
from rmll_train.environment import GaitEnv
from rmll_train.learner import GaitPPO
from rmll_train.settings import Settings
from rmll_train.simulation import training_model

SETTINGS = Settings()
ENVS = SETTINGS.world.envs


@pytest.fixture(scope="module")
def env() -> GaitEnv:
    return GaitEnv(load_gait("trot"), A1, SETTINGS.world, 0)


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
    learner = GaitPPO(env, SETTINGS.learner)

    def iteration() -> None:
        obs = env.get_observations()
        with torch.inference_mode():
            for _ in range(SETTINGS.learner.rollout):
                obs, rewards, dones, extras = env.step(learner.act(obs))
                learner.process_env_step(obs, rewards, dones, extras)
            learner.compute_returns(obs)
        learner.update()

    benchmark.pedantic(iteration, rounds=5, warmup_rounds=1)
