"""The policy without exploration in the trainer's world, and how it is judged."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from tensordict import TensorDict
from torch import Tensor

from rmll_contract.usefulness import shortfalls
from rmll_gaits.table import MachineTable
from rmll_robots import Robot
from rmll_train.env.environment import GaitEnv
from rmll_train.env.episode_metrics import EpisodeMetrics
from rmll_train.env.safety_limits import SafetyLimits
from rmll_train.train_settings import EnvSettings, GroundSettings

ROBOTS = 64
SECONDS = 10.0
"""of each judged walk"""
WHERE = "on flat ground, over all commands, with noise, without pushes"
"""What :class:`Judge` measures"""

AfterStep = Callable[[int, Tensor], None]
"""Told the number of a policy step and the actions (n, size) that were taken in it"""


@torch.no_grad()
def evaluate(
    actor: Callable[[TensorDict], Tensor],
    env: GaitEnv,
    steps: int,
    after_step: AfterStep = lambda step, actions: None,
) -> EpisodeMetrics:
    """Walk all robots of ``env`` for ``steps`` policy steps, after a second that does not count.

    By all rules of the gait, also if the demands of its training never became strict; they stay so.
    """
    env.demands.progress = 1.0
    settling = env.robot.policy_hz
    for step in range(steps + settling):
        if step == settling:
            env.take_metrics()
        actions = actor(env.get_observations())
        env.step(actions)
        after_step(step + 1, actions)
    return env.take_metrics()


@dataclass(frozen=True)
class Judgement:
    """What :class:`Judge` saw."""

    metrics: dict[str, float]
    shortfalls: list[str]
    """What keeps the policy from being useful, in words"""
    limits: list[str]
    """What the robot's daemon would say of it, in words"""

    @property
    def useful(self) -> bool:
        return not self.shortfalls


class Judge:
    """A world of its own in which a policy walks now and then: flat ground, nobody pushes.

    The robots differ, and their sensors are noisy, as in training.
    """

    def __init__(self, table: MachineTable, robot: Robot, world: EnvSettings, seed: int):
        calm = replace(world.randomisation, push_velocity=0.0)
        longer = 2 * SECONDS  # so that no command changes and no episode ends for its age
        world = replace(
            world, envs=ROBOTS, ground=GroundSettings(), randomisation=calm, episode=longer,
            command_interval=longer,
        )  # fmt: skip
        self._env = GaitEnv(table, robot, world, seed)
        self._env.demands.progress = 1.0
        self.steps = round((SECONDS + 1) * robot.policy_hz)
        """Policy steps of a judgement"""

    def __call__(
        self,
        actor: Callable[[TensorDict], Tensor],
        progress: Callable[[int], None] = lambda step: None,
    ) -> Judgement:
        """``progress`` is told how many policy steps are done."""
        env = self._env
        env.begin_anew()
        limits = SafetyLimits(env)

        def after_step(step: int, actions: Tensor) -> None:
            limits.observe(actions)
            progress(step)

        sums = evaluate(actor, env, self.steps - env.robot.policy_hz, after_step)
        metrics = sums.metrics()
        return Judgement(metrics, shortfalls(metrics, env.table.commands), limits.touched())
