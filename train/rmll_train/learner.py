"""PPO for rare, large gait bonuses, with the state estimator trained beside it.

rsl-rl's PPO keeps the rollout and scores it; acting and learning are here: rewards are divided by
the spread of the return, matrix products run in bfloat16, symmetric states are folded, and the
estimator has its own loss and optimiser.
"""

import math
from typing import Any, NamedTuple

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor, nn

from rmll_gaits.errors import Failure
from rmll_train.environment import GaitEnv
from rmll_train.folding import Fold, images
from rmll_train.network import ACTIVATION, EstimatingActor, FoldedCritic, estimate_loss
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


class GaitPPO(PPO):
    """PPO whose actor carries an estimator.

    rsl-rl's update reads the rollout again for every mini-batch; this one folds, estimates and
    shuffles it once, which on a CPU is most of the time that is not spent in matrix products.
    """

    def __init__(self, env: GaitEnv, settings: Learner):
        s = settings
        self._rate_range = s.rate_range
        obs = env.get_observations()
        states = images(env.table, s.symmetry)
        actor = EstimatingActor(
            obs, OBSERVATION_GROUPS, "actor", env.num_actions, hidden_dims=s.hidden,
            activation=ACTIVATION, fold=Fold(env.robot, states, env.groups["policy"]),
            estimator_hidden=s.estimator_hidden,
            distribution_cfg={
                "class_name": "GaussianDistribution", "init_std": s.initial_std, "std_type": "log",
                "std_range": (s.minimum_std, 2.0),
            },
        )  # fmt: skip
        critic = FoldedCritic(
            obs, OBSERVATION_GROUPS, "critic", 1, hidden_dims=s.hidden, activation=ACTIVATION,
            fold=Fold(env.robot, states, env.groups["critic"]),
        )  # fmt: skip
        storage = RolloutStorage("rl", env.num_envs, s.rollout, obs, [env.num_actions])
        super().__init__(
            actor, critic, storage, num_learning_epochs=s.epochs, num_mini_batches=s.mini_batches,
            clip_param=s.clip, gamma=s.gamma, lam=s.lam, entropy_coef=s.entropy[0],
            learning_rate=s.learning_rate, max_grad_norm=s.max_gradient,
            use_clipped_value_loss=s.clip_value, desired_kl=s.desired_kl,
            use_mixed_precision=s.bf16,
        )  # fmt: skip
        self.policy = actor
        """The actor again, under its own type"""
        self._critic_fold = critic.fold
        # the estimator has its own optimiser: it learns from what is true, not from rewards
        self._estimating = list(actor.estimator.parameters())
        spread = list(actor.distribution.parameters())
        self._acting = [*actor.mlp.parameters(), *spread]
        self._judging = list(critic.parameters())
        layers = [*actor.mlp.parameters(), *self._judging]
        groups = [{"params": layers, "factor": 1.0}, {"params": spread, "factor": s.spread_rate}]
        self.optimizer = torch.optim.Adam(groups, lr=s.learning_rate, fused=True)
        self.estimator_optimizer = torch.optim.Adam(
            self._estimating, lr=s.estimator_rate, fused=True
        )
        self.estimator_batches = s.estimator_batches
        self.return_scale = ReturnScale(env.num_envs, s.gamma) if s.normalise_returns else None
        self.skipped_steps = 0
        """Optimiser steps left out so far because a gradient was not finite"""
        self._lost_updates = 0

    @property
    def learning_rate(self) -> float:
        return self._learning_rate

    @learning_rate.setter
    def learning_rate(self, wanted: float) -> None:
        low, high = self._rate_range
        self._learning_rate = min(high, max(low, wanted))

    def act(self, obs: TensorDict) -> Tensor:
        """Actions (envs, 12) with exploration; remembers what the update needs."""
        actor, fold, kept = self.policy, self.policy.fold, self.transition
        turned = fold.turned(obs["policy"])
        seen = TensorDict(
            {
                "policy": fold.observation(obs["policy"], turned),
                "critic": self._critic_fold.observation(obs["critic"], turned),
                "estimate": fold.estimate(obs["estimate"], turned),
            },
            batch_size=obs.batch_size,
        )
        with self._precision():
            mean = actor.mlp(actor.with_estimate(seen["policy"])).float()
            kept.values = self.critic.mlp(seen["critic"]).float()
        actor.distribution.update(mean)
        kept.actions = actor.distribution.sample()
        kept.actions_log_prob = actor.distribution.log_prob(kept.actions)
        kept.distribution_params = (mean,)
        kept.observations = seen
        kept.hidden_states = (None, None)
        return fold.action(kept.actions, turned)

    def process_env_step(
        self, obs: TensorDict, rewards: Tensor, dones: Tensor, extras: dict[str, Any]
    ) -> None:
        if self.return_scale is not None:
            rewards = self.return_scale(rewards, dones)
        super().process_env_step(obs, rewards, dones, extras)

    def update(self) -> dict[str, float]:
        """Epochs of PPO over the rollout, then one pass of the estimator over it.

        Raises Failure if ten updates in a row changed nothing for want of finite gradients.
        """
        skipped_before, steps = self.skipped_steps, self.num_learning_epochs * self.num_mini_batches
        order = torch.randperm(self.storage.rewards.numel())
        samples = self._samples(order)
        deviation = self.policy.distribution.std[0].clone()
        losses = [
            self._learn(batch, deviation)
            for _ in range(self.num_learning_epochs)
            for batch in samples.batches(self.num_mini_batches)
        ]
        skipped_all = self.skipped_steps - skipped_before >= steps
        self._lost_updates = self._lost_updates + 1 if skipped_all else 0
        if self._lost_updates >= 10:
            raise Failure("training diverged: ten updates in a row had no finite gradients")
        surrogate, value, entropy = torch.stack(losses).mean(0).tolist()
        # after PPO: within its epochs the estimates stay those that the actions were drawn from
        estimator = self._update_estimator(order)
        self.storage.clear()
        return {
            "surrogate": surrogate, "value": value, "entropy": entropy, "estimator": estimator,
        }  # fmt: skip

    def _samples(self, order: Tensor) -> Samples:
        stored = self.storage
        observed = stored.observations.flatten(0, 1)
        with torch.no_grad():
            actor_input = self.policy.with_estimate(observed["policy"])
        kind = torch.bfloat16 if self.use_mixed_precision else torch.float32
        assert stored.distribution_params is not None, "an update before the first rollout"
        flat = (stored.actions, *stored.distribution_params, stored.actions_log_prob,
                stored.values, stored.returns, stored.advantages)  # fmt: skip
        return Samples(
            actor_input.to(kind)[order],
            observed["critic"].to(kind)[order],
            *(part.flatten(0, 1)[order] for part in flat),
        )

    def _learn(self, batch: Samples, old_deviation: Tensor) -> Tensor:
        """One step of PPO (Schulman et al. 2017); returns surrogate and value loss, and entropy."""
        with self._precision():
            mean = self.policy.mlp(batch.actor_input).float()
            value = self.critic.mlp(batch.critic_input).float()
        distribution = self.policy.distribution
        distribution.update(mean)
        self._follow_divergence(batch.mean, old_deviation)

        ratio = (distribution.log_prob(batch.action) - batch.log_prob[:, 0]).exp()
        advantage = batch.advantage[:, 0]
        bounded = ratio.clamp(1 - self.clip_param, 1 + self.clip_param)
        surrogate = -torch.minimum(advantage * ratio, advantage * bounded).mean()
        error = (value - batch.returns).square()
        if self.use_clipped_value_loss:
            near = batch.value + (value - batch.value).clamp(-self.clip_param, self.clip_param)
            error = torch.maximum(error, (near - batch.returns).square())
        value_loss = error.mean()
        entropy = distribution.entropy.mean()

        self.optimizer.zero_grad()
        (surrogate + value_loss - self.entropy_coef * entropy).backward()
        self._apply(self.optimizer, self.max_grad_norm, self._acting, self._judging)
        return torch.stack([surrogate, value_loss, entropy]).detach()

    @torch.no_grad()
    def _follow_divergence(self, old_mean: Tensor, old_deviation: Tensor) -> None:
        """Lower the learning rate when the policy moves away too fast, raise it when too slowly."""
        distribution = self.policy.distribution
        old, new = (old_mean, old_deviation), (distribution.mean, distribution.std)
        divergence = float(distribution.kl_divergence(old, new).mean())
        if divergence > 2 * self.desired_kl:
            self.learning_rate /= 1.5
        elif 0 < divergence < self.desired_kl / 2:
            self.learning_rate *= 1.5
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate * group["factor"]

    def _update_estimator(self, order: Tensor) -> float:
        observed = self.storage.observations.flatten(0, 1)
        own, true = observed["policy"][order], observed["estimate"][order]
        losses = []
        for seen, wanted in zip(
            own.chunk(self.estimator_batches), true.chunk(self.estimator_batches), strict=True
        ):
            with self._precision():
                estimate = self.policy.estimator(seen).float()
            loss = estimate_loss(estimate, wanted)
            self.estimator_optimizer.zero_grad()
            loss.backward()
            self._apply(self.estimator_optimizer, math.inf, self._estimating)
            losses.append(loss.detach())
        return float(torch.stack(losses).mean())

    def _apply(
        self, optimizer: torch.optim.Optimizer, limit: float, *networks: list[nn.Parameter]
    ) -> None:
        """Step, each network's gradient clipped to ``limit``; left out if any is not finite."""
        norms = [nn.utils.clip_grad_norm_(part, limit) for part in networks]
        if torch.stack(norms).isfinite().all():
            optimizer.step()
        else:
            self.skipped_steps += 1

    def _precision(self) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=self.use_mixed_precision)

    def state(self) -> dict[str, Any]:
        """Everything a resumed run needs to go on."""
        saved = super().save()
        saved["estimator_optimizer"] = self.estimator_optimizer.state_dict()
        saved["return_scale"] = self.return_scale.state_dict() if self.return_scale else None
        saved["learning_rate"] = self.learning_rate
        saved["skipped"] = self.skipped_steps
        return saved

    def restore(self, saved: dict[str, Any]) -> None:
        super().load(saved, None, strict=True)
        self.estimator_optimizer.load_state_dict(saved["estimator_optimizer"])
        if self.return_scale is not None:
            self.return_scale.load_state_dict(saved["return_scale"])
        self.learning_rate = saved["learning_rate"]
        self.skipped_steps = saved["skipped"]
