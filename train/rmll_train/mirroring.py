"""Mirror symmetry in PPO: what a robot went through could have happened with its sides swapped.

In each epoch each transition is shown as it was or mirrored, at even odds, so that an update costs
hardly more than without symmetry; appending the mirror images, as rsl-rl does, doubles it.

A mirrored action was drawn by the mirrored policy, hence the PPO ratio is taken to that one's
probability, which is the stored one (Mittal et al. 2024). The policy's change that steers the
learning rate is measured at the mirrored observation, where the old policy is asked again.
"""

from collections.abc import Generator
from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor

from rmll_contract.mirror import Mirror, mirror_action, mirror_layout
from rmll_gaits.errors import InputError
from rmll_gaits.symmetry import mirror_states
from rmll_train.environment import GaitEnv


class Reflection:
    """Mirror images of an environment's observation groups and actions."""

    def __init__(self, env: GaitEnv, states: tuple[int, ...]):
        """``states`` is the mirror image of each of the automaton's states."""
        layouts = env.groups.items()
        self._groups = {name: _tensors(mirror_layout(fields, states)) for name, fields in layouts}
        self._action = _tensors(mirror_action(env.robot))

    def observations(self, obs: TensorDict) -> TensorDict:
        images = {name: _image(obs[name], mirror) for name, mirror in self._groups.items()}
        return TensorDict(images, batch_size=obs.batch_size)

    def mixed(self, obs: TensorDict) -> TensorDict:
        """Rows (n,) of which each is mirrored at even odds."""
        images, mirrored = self.observations(obs), torch.rand(len(obs), 1) < 0.5
        rows = {name: torch.where(mirrored, images[name], obs[name]) for name in self._groups}
        return TensorDict(rows, batch_size=obs.batch_size)

    def actions(self, actions: Tensor) -> Tensor:
        return _image(actions, self._action)


def reflection(env: GaitEnv, wanted: bool | str) -> Reflection | None:
    """The mirror to learn with, if any; ``wanted`` is the setting ``learner.symmetry``.

    Raises InputError if symmetry is insisted on and the gait has none.
    """
    states = mirror_states(env.table) if wanted else None
    if states is not None:
        return Reflection(env, states)
    if wanted is True:
        raise InputError(f"gait {env.table.gait} has no mirror symmetry")
    return None


class MirroredStorage(RolloutStorage):
    """A rollout whose mini-batches show each transition as it was or mirrored."""

    def __init__(self, reflection: Reflection, actor: MLPModel, bf16: bool, *args: Any):
        super().__init__(*args)
        self._reflection, self._actor, self._bf16 = reflection, actor, bf16

    def mini_batch_generator(
        self, num_mini_batches: int, num_epochs: int = 8
    ) -> Generator[RolloutStorage.Batch, None, None]:
        """As rsl-rl's; the first must be taken before the policy changes."""
        assert self.distribution_params is not None
        plain = self.observations.flatten(0, 1)
        images = self._reflection.observations(plain)
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16, self._bf16):
            self._actor(images, stochastic_output=True)
        # rows 0..count-1 are the transitions, the same number after them their mirror images
        count = len(plain)
        observations = TensorDict.cat([plain, images])
        taken = self.actions.flatten(0, 1)
        actions = torch.cat([taken, self._reflection.actions(taken)])
        params = [
            torch.cat([old.flatten(0, 1), image])
            for old, image in zip(
                self.distribution_params, self._actor.output_distribution_params, strict=True
            )
        ]
        log_prob, values, advantages, returns = (
            stored.flatten(0, 1)
            for stored in (self.actions_log_prob, self.values, self.advantages, self.returns)
        )
        for _ in range(num_epochs):
            for rows in torch.randperm(count).tensor_split(num_mini_batches):
                shown = rows + count * torch.randint(2, rows.shape)
                yield RolloutStorage.Batch(
                    observations=observations[shown],
                    actions=actions[shown],
                    old_distribution_params=tuple(param[shown] for param in params),
                    old_actions_log_prob=log_prob[rows],
                    values=values[rows],
                    advantages=advantages[rows],
                    returns=returns[rows],
                )


def _image(vector: Tensor, mirror: tuple[Tensor, Tensor]) -> Tensor:
    source, sign = mirror
    return vector[..., source] * sign


def _tensors(mirror: Mirror) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(mirror.source), torch.from_numpy(mirror.sign)
