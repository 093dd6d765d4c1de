"""What the daemon would say of a walk, seen in the trainer's world."""

import torch

from rmll_gaits.load import load_gait
from rmll_onboard.settings.runtime_settings import Safety
from rmll_robots import A1
from rmll_train.env.environment import GaitEnv
from rmll_train.env.safety_limits import SafetyLimits
from rmll_train.train_settings import EnvSettings

ENVS = 4
LIMIT = Safety().stuck
NO_ACTION = torch.zeros(ENVS, 12)


def limits() -> tuple[GaitEnv, SafetyLimits]:
    env = GaitEnv(load_gait("trot"), A1, EnvSettings(envs=ENVS), seed=0)
    env.simulation.joint_velocity = torch.zeros(ENVS, 12)
    return env, SafetyLimits(env)


def test_a_robot_within_all_limits_is_not_spoken_of() -> None:
    _, watched = limits()
    for _ in range(100):
        watched.observe(NO_ACTION)
    assert watched.touched() == []


def test_a_joint_that_keeps_turning_too_fast_is_told_with_how_fast_and_how_often() -> None:
    env, watched = limits()
    env.simulation.joint_velocity[2, 5] = -22.6
    for _ in range(3):
        watched.observe(NO_ACTION)
    (said,) = watched.touched()
    limit = Safety().joint_speed
    assert said == f"a joint turned at 22.6 rad/s, limit {limit:g}, in 1 of 4 walks"


def test_a_single_moment_passes_as_it_does_in_the_daemon() -> None:
    env, watched = limits()
    for speed in (25.0, 0.0, 25.0, 0.0):
        env.simulation.joint_velocity[0, 0] = speed
        watched.observe(NO_ACTION)
    assert watched.touched() == []


def test_wild_actions_and_a_stuck_gait_are_told() -> None:
    env, watched = limits()
    env.phi[1] = round(11 * float(env.command[1, 2]))
    wild = NO_ACTION.clone()
    wild[3, 0] = 2.5 * A1.action_clip
    for _ in range(4):
        watched.observe(wild)
    action, stuck = watched.touched()
    assert action == "an action was 2.5 times its range, limit 2, in 1 of 4 walks"
    assert stuck == f"no transition came for 11 times c_f, limit {LIMIT:g}, in 1 of 4 walks"
