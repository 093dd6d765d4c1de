"""Mirror symmetry in PPO: what a robot went through could have happened with its sides swapped.

In each epoch each transition is shown as it was or mirrored, at even odds, so that an update costs
hardly more than without symmetry; appending the mirror images, as rsl-rl does, doubles it.

A mirrored action was drawn by the mirrored policy, hence the PPO ratio is taken to that one's
probability, which is the stored one (Mittal et al. 2024). The change of the policy that steers the
learning rate is another thing: from the old policy at the mirrored observation to the new one there.
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

    def __init__(self, reflection: Reflection, actor: MLPModel, *args: Any):
        super().__init__(*args)
        self._reflection, self._actor = reflection, actor

    def mini_batch_generator(
        self, num_mini_batches: int, num_epochs: int = 8
    ) -> Generator[RolloutStorage.Batch, None, None]:
        """As rsl-rl's; the first must be taken before the policy changes."""
        whole = next(super().mini_batch_generator(1, 1))
        assert whole.observations is not None and whole.actions is not None
        images = self._reflection.observations(whole.observations)
        with torch.no_grad():
            self._actor(images, stochastic_output=True)
            image_params = self._actor.output_distribution_params
        # rows 0..count-1 are the transitions, the same number after them their mirror images
        count = len(whole.actions)
        observations = torch.cat([whole.observations, images])
        actions = torch.cat([whole.actions, self._reflection.actions(whole.actions)])
        params = [torch.cat(pair) for pair in zip(whole.old_distribution_params, image_params)]
        for _ in range(num_epochs):
            shown = torch.arange(count) + count * torch.randint(2, (count,))
            for rows in torch.arange(count).tensor_split(num_mini_batches):
                pick = shown[rows]
                yield RolloutStorage.Batch(
                    observations=observations[pick],
                    actions=actions[pick],
                    values=whole.values[rows],
                    advantages=whole.advantages[rows],
                    returns=whole.returns[rows],
                    old_actions_log_prob=whole.old_actions_log_prob[rows],
                    old_distribution_params=tuple(param[pick] for param in params),
                )


def _image(vector: Tensor, mirror: tuple[Tensor, Tensor]) -> Tensor:
    index, sign = mirror
    return vector[..., index] * sign


def _tensors(mirror: Mirror) -> tuple[Tensor, Tensor]:
    return torch.from_numpy(mirror.index), torch.from_numpy(mirror.sign)
