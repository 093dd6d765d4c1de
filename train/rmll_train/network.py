"""The networks: an actor that estimates what it cannot measure, and a critic that is told.

The actor is exactly what the robot runs: observation -> estimator -> (observation, scaled
estimates) -> action.
"""

from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.modules import MLP
from tensordict import TensorDict
from torch import Tensor

from rmll_contract import observation

ESTIMATE_SIZE = observation.size(observation.ESTIMATES)
# Heights are centimetres, velocities decimetres a second: weights that make both errors count.
_LOSS_WEIGHT = (1.0,) * 3 + (100.0,) * 4


class EstimatingActor(MLPModel):
    """MLP over the ``policy`` observation and the concurrent estimator's output (Ji et al. 2022).

    No gradient flows from the policy into the estimator, which learns by regression alone.
    """

    estimate_scale: Tensor

    def __init__(self, *args: Any, estimator_hidden: tuple[int, ...] = (128, 128), **kwargs: Any):
        super().__init__(*args, **kwargs)
        self.estimator = MLP(self.obs_dim, ESTIMATE_SIZE, estimator_hidden, "elu")
        scales = [torch.full((field.size,), field.scale) for field in observation.ESTIMATES]
        self.register_buffer("estimate_scale", torch.cat(scales))

    def get_latent(self, obs: TensorDict, masks: Any = None, hidden_state: Any = None) -> Tensor:
        own = super().get_latent(obs, masks, hidden_state)
        with torch.no_grad():
            estimate = self.estimator(own)
        return torch.cat([own, estimate * self.estimate_scale], dim=-1)

    def estimate(self, own: Tensor) -> Tensor:
        """Base velocity (3) [m/s], foot heights (4) [m] from ``policy`` observations (..., n)."""
        return self.estimator(own)

    def _get_latent_dim(self) -> int:
        return self.obs_dim + ESTIMATE_SIZE


def estimate_loss(estimate: Tensor, true: Tensor) -> Tensor:
    """Weighted mean squared error of estimates (n, 7)."""
    return ((estimate - true).square() * torch.tensor(_LOSS_WEIGHT)).mean()
