"""What is remembered of a rollout, and the form in which PPO learns from it."""

from typing import NamedTuple

import torch
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor

from rmll_train.learning.actor_critic import ESTIMATE_SIZE, EstimatingActor


class Samples(NamedTuple):
    """A rollout as PPO learns from it, one row a step of a robot, each (n, ...).

    Everything is as the networks see it: in the turned states, mirrored.
    """

    actor_input: Tensor
    critic_input: Tensor
    action: Tensor
    mean: Tensor
    """of the distribution from which the action was drawn"""
    log_prob: Tensor
    value: Tensor
    returns: Tensor
    advantage: Tensor

    def batches(self, count: int) -> list["Samples"]:
        return [Samples(*parts) for parts in zip(*(t.chunk(count) for t in self), strict=True)]


def remembered(actor: EstimatingActor, obs: TensorDict, bf16: bool) -> TensorDict:
    """Zeros in the form of what is remembered of each observation.

    "policy" is what the actor's layers took, the estimate included; both networks' inputs are
    remembered in the precision in which their products are.
    """
    kind = torch.bfloat16 if bf16 else torch.float32
    (robots,) = obs.batch_size
    kept = {
        "policy": torch.zeros(robots, actor.obs_dim + ESTIMATE_SIZE, dtype=kind),
        "critic": torch.zeros_like(obs["critic"], dtype=kind),
        "estimate": torch.zeros_like(obs["estimate"]),
    }
    return TensorDict(kept, batch_size=obs.batch_size)


def collected(storage: RolloutStorage, order: Tensor) -> Samples:
    """A whole rollout, its rows in this order."""
    observed = storage.observations.flatten(0, 1)
    assert storage.distribution_params is not None, "an update before the first rollout"
    flat = (storage.actions, *storage.distribution_params, storage.actions_log_prob,
            storage.values, storage.returns, storage.advantages)  # fmt: skip
    return Samples(
        observed["policy"].index_select(0, order),
        observed["critic"].index_select(0, order),
        *(part.flatten(0, 1).index_select(0, order) for part in flat),
    )
