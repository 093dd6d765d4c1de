"""A pass of gradient steps, those without finite gradients left out and counted."""

import itertools
from typing import NamedTuple

import torch
from torch import Tensor, nn


class StepReport(NamedTuple):
    """What came of it."""

    losses: tuple[float, ...]
    """Means over the steps"""
    skipped: int
    """Steps that were left out"""
    steps: int
    """in all"""


class OptimizerStep:
    """Steps of one optimiser, the gradient of all its parameters clipped to the norm ``limit``."""

    def __init__(self, optimizer: torch.optim.Optimizer, limit: float):
        self._optimizer, self._limit = optimizer, limit
        groups = optimizer.param_groups
        self._parameters = list(itertools.chain(*(group["params"] for group in groups)))
        self._told: list[Tensor] = []
        self._skipped = 0

    def step(self, loss: Tensor, *told: Tensor) -> None:
        """Down the gradient of ``loss``; ``told``, scalars, are what to report of it."""
        self.begin()
        loss.backward()
        self.apply(*told)

    def begin(self) -> None:
        """Forget the last step's gradient."""
        self._optimizer.zero_grad()

    def apply(self, *told: Tensor) -> None:
        """A step down the gradient that was collected since :meth:`begin`."""
        if nn.utils.clip_grad_norm_(self._parameters, self._limit).isfinite():
            self._optimizer.step()
        else:
            self._skipped += 1
        self._told.append(torch.stack(told).detach())

    def end(self) -> StepReport:
        return StepReport(
            tuple(torch.stack(self._told).mean(0).tolist()), self._skipped, len(self._told)
        )
