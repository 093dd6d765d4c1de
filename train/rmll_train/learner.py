"""PPO for rare, large gait bonuses, with the state estimator trained beside it.

rsl-rl's PPO collects and scores; what differs from it is here: rewards are divided by the spread of
the return, matrix products run in bfloat16, and the estimator has its own loss and optimiser.
"""

from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor, nn

from rmll_gaits.errors import Failure
from rmll_train.environment import GaitEnv
from rmll_train.folding import Fold, images
from rmll_train.network import EstimatingActor, FoldedCritic, estimate_loss
from rmll_train.settings import Learner

OBSERVATION_GROUPS = {"actor": ["policy"], "critic": ["critic"]}


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


class FiniteAdam(torch.optim.Adam):
    """Adam that leaves out steps whose gradients are not finite, and counts them."""

    skipped = 0

    def step(self, closure: Any = None) -> None:
        gradients = [p.grad for group in self.param_groups for p in group["params"]]
        total = torch.stack([g.sum() for g in gradients if g is not None]).sum()
        if total.isfinite():
            super().step(closure)
        else:
            self.skipped += 1


class GaitPPO(PPO):
    """PPO whose actor carries an estimator."""

    def __init__(self, env: GaitEnv, settings: Learner):
        s = settings
        self._rate_range = s.rate_range
        obs = env.get_observations()
        states = images(env.table, s.symmetry)
        actor = EstimatingActor(
            obs, OBSERVATION_GROUPS, "actor", env.num_actions, hidden_dims=s.hidden,
            fold=Fold(env.robot, states, env.groups["policy"]),
            estimator_hidden=s.estimator_hidden,
            distribution_cfg={
                "class_name": "GaussianDistribution", "init_std": s.initial_std, "std_type": "log",
                "std_range": (s.minimum_std, 2.0),
            },
        )  # fmt: skip
        critic = FoldedCritic(
            obs, OBSERVATION_GROUPS, "critic", 1, hidden_dims=s.hidden,
            fold=Fold(env.robot, states, env.groups["critic"]),
        )  # fmt: skip
        storage = RolloutStorage("rl", env.num_envs, s.rollout, obs, [env.num_actions])
        super().__init__(
            actor, critic, storage, num_learning_epochs=s.epochs, num_mini_batches=s.mini_batches,
            clip_param=s.clip, gamma=s.gamma, lam=s.lam, entropy_coef=s.entropy,
            learning_rate=s.learning_rate, max_grad_norm=s.max_gradient,
            use_clipped_value_loss=s.clip_value, desired_kl=s.desired_kl,
            use_mixed_precision=s.bf16,
        )  # fmt: skip
        self.policy = actor
        """The actor again, under its own type"""
        # the estimator has its own optimiser; PPO's must not see its parameters
        estimator = set(actor.estimator.parameters())
        trained = [p for p in [*actor.parameters(), *critic.parameters()] if p not in estimator]
        self.optimizer = FiniteAdam(trained, lr=s.learning_rate)
        self.estimator_optimizer = FiniteAdam(actor.estimator.parameters(), lr=s.estimator_rate)
        self.estimator_batches = s.estimator_batches
        self.return_scale = ReturnScale(env.num_envs, s.gamma) if s.normalise_returns else None
        self._lost_updates = 0

    @property
    def learning_rate(self) -> float:
        return self._learning_rate

    @learning_rate.setter
    def learning_rate(self, wanted: float) -> None:
        """rsl-rl's schedule sets it after every mini-batch; kept within our own bounds."""
        low, high = self._rate_range
        self._learning_rate = min(high, max(low, wanted))

    def process_env_step(
        self, obs: TensorDict, rewards: Tensor, dones: Tensor, extras: dict[str, Any]
    ) -> None:
        if self.return_scale is not None:
            rewards = self.return_scale(rewards, dones)
        super().process_env_step(obs, rewards, dones, extras)

    def update(self) -> dict[str, float]:
        """One PPO update, then one pass of the estimator over the same batch.

        Raises Failure if ten updates in a row changed nothing for want of finite gradients.
        """
        before = self.skipped_steps
        observed = self.storage.observations.flatten(0, 1)
        losses = super().update()
        # after PPO: within its epochs the estimates stay those that the actions were drawn from
        losses["estimator"] = self._update_estimator(observed["policy"], observed["estimate"])
        skipped_all = (
            self.skipped_steps - before >= self.num_learning_epochs * self.num_mini_batches
        )
        self._lost_updates = self._lost_updates + 1 if skipped_all else 0
        if self._lost_updates >= 10:
            raise Failure("training diverged: ten updates in a row had no finite gradients")
        return losses

    @property
    def skipped_steps(self) -> int:
        """Optimiser steps left out so far."""
        return self.optimizer.skipped + self.estimator_optimizer.skipped

    def _update_estimator(self, own: Tensor, true: Tensor) -> float:
        total = 0.0
        batches = torch.randperm(len(own)).chunk(self.estimator_batches)
        for batch in batches:
            loss = estimate_loss(self.policy.estimate(own[batch]), true[batch])
            self.estimator_optimizer.zero_grad()
            loss.backward()
            self.estimator_optimizer.step()
            total += loss.item()
        # PPO clips the gradients of the whole actor: none of these may be among them
        self.estimator_optimizer.zero_grad()
        return total / len(batches)

    def state(self) -> dict[str, Any]:
        """Everything a resumed run needs to go on."""
        saved = super().save()
        saved["estimator_optimizer"] = self.estimator_optimizer.state_dict()
        saved["return_scale"] = self.return_scale.state_dict() if self.return_scale else None
        saved["learning_rate"] = self.learning_rate
        saved["skipped"] = self.optimizer.skipped, self.estimator_optimizer.skipped
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        super().load(saved, None, strict=True)
        self.estimator_optimizer.load_state_dict(saved["estimator_optimizer"])
        if self.return_scale is not None:
            self.return_scale.load_state_dict(saved["return_scale"])
        self.learning_rate = saved["learning_rate"]
        self.optimizer.skipped, self.estimator_optimizer.skipped = saved["skipped"]
