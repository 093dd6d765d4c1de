"""What is remembered of a rollout, and the form in which PPO learns from it."""

from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor

from rmll_train.network import ESTIMATE_SIZE, EstimatingActor


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
