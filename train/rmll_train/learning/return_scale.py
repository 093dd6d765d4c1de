"""Rewards of any size, brought to the size of one for the critic."""

import torch
from torch import Tensor, nn


class ReturnScale(nn.Module):
    """Running standard deviation of the discounted return, by which rewards are divided.

    Without it the critic has to reach values of several hundred (the bonus is 1000) through an
    output layer that starts at zero. Moments are averaged over about 500 policy steps.
    """

    discounted: Tensor
    moment: Tensor

    def __init__(self, envs: int, gamma: float, horizon: float = 500.0):
        super().__init__()
        self.gamma, self.rate = gamma, 1.0 / horizon
        self.register_buffer("discounted", torch.zeros(envs))
        self.register_buffer("moment", torch.zeros(2))

    def forward(self, rewards: Tensor, dones: Tensor) -> Tensor:
        """Scaled rewards (envs,); updates the scale."""
        self.discounted = self.discounted * self.gamma + rewards
        square = self.discounted.square().mean()
        # moment[1] is the weight collected so far: it removes the bias of the start at zero
        self.moment = self.moment + self.rate * (
            torch.stack([square, torch.ones(())]) - self.moment
        )
        self.discounted = self.discounted * ~dones.bool()
        return rewards / (self.moment[0] / self.moment[1] + 1e-8).sqrt()
