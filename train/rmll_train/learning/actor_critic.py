"""The networks: an actor that estimates what it cannot measure, and a critic that is told.

The actor is exactly what the robot runs: observation -> estimator -> (observation, scaled
estimates) -> action.
"""

from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.modules import MLP
from rsl_rl.modules.distribution import GaussianDistribution
from tensordict import TensorDict
from torch import Tensor

from rmll_contract import observation
from rmll_train.learning.network_symmetry import NetworkSymmetry

ACTIVATION = "relu"
ESTIMATE_SIZE = observation.size(observation.ESTIMATES)
# Heights are centimetres, velocities decimetres a second: weights that make both errors count.
_LOSS_WEIGHT = (1.0,) * 3 + (100.0,) * 4


class EstimatingActor(MLPModel):
    """MLP over the ``policy`` observation and the concurrent estimator's output (Ji et al. 2022).

    No gradient flows from the policy into the estimator, which learns by regression alone.
    """

    estimate_scale: Tensor
    distribution: GaussianDistribution  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        *args: Any,
        fold: NetworkSymmetry,
        estimator_hidden: tuple[int, ...] = (128, 128),
        **kwargs: Any,
    ):
        super().__init__(*args, **kwargs)
        self.fold = fold
        self.estimator = MLP(self.obs_dim, ESTIMATE_SIZE, estimator_hidden, ACTIVATION)
        scales = [torch.full((field.size,), field.scale) for field in observation.ESTIMATES]
        self.register_buffer("estimate_scale", torch.cat(scales))

    def forward(
        self, obs: TensorDict, masks: Any = None, hidden_state: Any = None,
        stochastic_output: bool = False,
    ) -> Tensor:  # fmt: skip
        return self.mean(obs["policy"])

    def mean(self, own: Tensor) -> Tensor:
        """Actions (n, 12) without exploration, from ``policy`` observations (n, size)."""
        turned = self.fold.mirrored(own)
        seen = self.fold.observation(own, turned)
        return self.fold.action(self.mlp(self.with_estimate(seen)), turned)

    def with_estimate(self, seen: Tensor) -> Tensor:
        """What the policy's layers take: folded observations (n, size) and scaled estimates."""
        with torch.no_grad():
            estimate = self.estimator(seen)
        return torch.cat([seen, estimate * self.estimate_scale], dim=-1)

    def estimate(self, own: Tensor) -> Tensor:
        """Base velocity (3) [m/s], foot heights (4) [m] from ``policy`` observations (n, size)."""
        turned = self.fold.mirrored(own)
        return self.fold.estimate(self.estimator(self.fold.observation(own, turned)), turned)

    def _get_latent_dim(self) -> int:
        return self.obs_dim + ESTIMATE_SIZE


class FoldedCritic(MLPModel):
    """MLP over the ``critic`` observation; a state is worth what its mirror image is worth."""

    def __init__(self, *args: Any, fold: NetworkSymmetry, **kwargs: Any):
        super().__init__(*args, **kwargs)
        self.fold = fold

    def get_latent(self, obs: TensorDict, masks: Any = None, hidden_state: Any = None) -> Tensor:
        true = super().get_latent(obs, masks, hidden_state)
        return self.fold.observation(true, self.fold.mirrored(true))


def estimate_loss(estimate: Tensor, true: Tensor) -> Tensor:
    """Weighted mean squared error of estimates (n, 7)."""
    return ((estimate - true).square() * torch.tensor(_LOSS_WEIGHT)).mean()
