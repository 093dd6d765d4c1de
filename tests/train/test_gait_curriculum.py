"""What is asked of all robots alike grows with how well they walk."""

import pytest
import torch

from rmll_gaits.load import load_gait
from rmll_robots import A1
from rmll_train.env.curriculum import GaitCurriculum
from rmll_train.env.environment import GaitEnv
from rmll_train.golden_trace import STILL
from rmll_train.train_settings import EnvSettings, Rewards

WEIGHT = 122.2
"""[N] of a robot with nothing added"""


def test_pressure_grows_only_while_gait_and_speed_are_held_and_stays_in_its_range() -> None:
    demands = GaitCurriculum(EnvSettings(rewards=Rewards(cost_scale=(0.5, 2.0))))
    demands.update(adherence=0.1, vx_error=0.0, steps=12)
    assert demands.cost_scale == 0.5
    for _ in range(500):
        demands.update(adherence=0.99, vx_error=0.05, steps=12)
    assert demands.cost_scale == 2.0
    demands.update(adherence=0.99, vx_error=0.5, steps=12)
    assert demands.cost_scale < 2.0


def test_reject_edges_open_once_the_gait_is_there_and_stay_open() -> None:
    demands = GaitCurriculum(EnvSettings(rewards=Rewards(strict_above_adherence=0.7)))
    for adherence, strict in ((0.6, False), (0.75, True), (0.1, True)):
        _hold(demands, adherence)
        assert demands.strict == strict
    assert GaitCurriculum(EnvSettings(rewards=Rewards(strict_above_adherence=0.0))).strict


def test_feet_have_to_be_lifted_higher_as_the_gait_comes_and_never_lower_again() -> None:
    rewards = Rewards(strict_above_adherence=0.7)
    demands = GaitCurriculum(EnvSettings(first_clearance=0.01, clearance=0.03, rewards=rewards))
    seen = [demands.clearance]
    for adherence in (0.35, 0.1, 0.9, 0.0):
        _hold(demands, adherence)
        seen.append(demands.clearance)
    assert seen == pytest.approx([0.01, 0.02, 0.02, 0.03, 0.03], abs=1e-4)


def test_robots_grow_heavy_as_the_gait_comes() -> None:
    world = EnvSettings(envs=2, first_gravity=0.4, randomisation=STILL)
    env = GaitEnv(load_gait("trot"), A1, world, seed=0)
    stand = torch.zeros(2, 12)
    for progress, share in ((0.0, 0.4), (1.0, 1.0)):
        env.demands.progress = progress
        for _ in range(50):
            env.step(stand)
        weight = env.simulation.foot_force.sum(1)
        assert weight.tolist() == pytest.approx([share * WEIGHT] * 2, rel=0.05)


def test_transitions_that_nobody_made_make_nothing_harder() -> None:
    """A pronk's robots begin on the ground, half of them in the state that waits for the ground. By
    the first rollout alone, feet would have to be lifted three times as high, and none would."""
    demands = GaitCurriculum(EnvSettings())
    demands.update(adherence=0.5, vx_error=0.5, steps=12)
    for _ in range(20):
        demands.update(adherence=0.0, vx_error=0.5, steps=12)
    assert demands.progress < 0.2


def _hold(demands: GaitCurriculum, adherence: float) -> None:
    for _ in range(10 * GaitCurriculum.MEMORY // 12):
        demands.update(adherence, vx_error=0.1, steps=12)
