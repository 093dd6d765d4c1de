"""PPO for rare, large gait bonuses, with the state estimator trained beside it.

rsl-rl's PPO keeps the rollout and scores it; acting and learning are here: rewards are divided by
the spread of the return, matrix products run in bfloat16, symmetric states are folded, and actor,
critic and estimator have each its own loss and optimiser.
"""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import copy
from itertools import cycle, islice
from typing import TypedDict

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import Tensor

from rmll_common.errors import Failure
from rmll_train.env.environment import GaitEnv
from rmll_train.learning.actor_critic import (
    ACTIVATION,
    EstimatingActor,
    FoldedCritic,
    estimate_loss,
)
from rmll_train.learning.network_symmetry import NetworkSymmetry, images
from rmll_train.learning.optimizer_step import OptimizerStep, StepReport
from rmll_train.learning.return_scale import ReturnScale
from rmll_train.learning.samples import Samples, collected, remembered
from rmll_train.train_settings import LearnerSettings

OBSERVATION_GROUPS = {"actor": ["policy"], "critic": ["critic"]}


class LearnerState(TypedDict):
    """Networks, optimisers and counters; the first three are rsl-rl's."""

    actor_state_dict: dict[str, Tensor]
    critic_state_dict: dict[str, Tensor]
    optimizer_state_dict: dict[str, object]
    critic_optimizer: dict[str, object]
    estimator_optimizer: dict[str, object]
    return_scale: dict[str, Tensor] | None
    rates: list[float]
    """At each of the actor's steps in the last update"""
    skipped: int


class GaitPPO(PPO):
    """PPO whose actor carries an estimator.

    rsl-rl's update reads the rollout again for every mini-batch; this one folds, estimates and
    shuffles it once, which on a CPU is most of the time that is not spent in matrix products.
    The critic works in a thread of its own beside the actor, each with half of the cores: they need
    each other once an update, where threads that share every operation wait for each other at each.
    When it is done with its epochs, it takes half of each of the actor's batches.
    """

    def __init__(self, env: GaitEnv, settings: LearnerSettings):
        s = settings
        bf16 = s.bf16 is True  # "auto" was found out before, see precision.py
        self._rate_range = s.rate_range
        obs = env.get_observations()
        states = images(env.table, s.symmetry)
        actor = EstimatingActor(
            obs, OBSERVATION_GROUPS, "actor", env.num_actions, hidden_dims=s.hidden,
            activation=ACTIVATION, fold=NetworkSymmetry(env.robot, states, env.groups["policy"]),
            estimator_hidden=s.estimator_hidden,
            distribution_cfg={
                "class_name": "GaussianDistribution", "init_std": s.initial_std, "std_type": "log",
                "std_range": (s.minimum_std, 2.0),
            },
        )  # fmt: skip
        critic = FoldedCritic(
            obs, OBSERVATION_GROUPS, "critic", 1, hidden_dims=s.hidden, activation=ACTIVATION,
            fold=NetworkSymmetry(env.robot, states, env.groups["critic"]),
        )  # fmt: skip
        storage = RolloutStorage(
            "rl", env.num_envs, s.rollout, remembered(actor, obs, bf16), [env.num_actions]
        )
        super().__init__(
            actor, critic, storage, num_learning_epochs=s.epochs, num_mini_batches=s.mini_batches,
            clip_param=s.clip, gamma=s.gamma, lam=s.lam, entropy_coef=s.entropy[0],
            learning_rate=s.learning_rate, max_grad_norm=s.max_gradient,
            use_clipped_value_loss=s.clip_value, desired_kl=s.desired_kl,
            use_mixed_precision=bf16,
        )  # fmt: skip
        self.policy = actor
        """The actor again, under its own type"""
        self._critic_fold = critic.fold
        spread = list(actor.distribution.parameters())
        groups = [
            {"params": list(actor.mlp.parameters()), "factor": 1.0},
            {"params": spread, "factor": s.spread_rate},
        ]
        self.optimizer = torch.optim.Adam(groups, lr=s.learning_rate, fused=True)
        """The actor's, as rsl-rl names it"""
        self.critic_optimizer = torch.optim.Adam(
            critic.parameters(), lr=s.learning_rate, fused=True
        )
        # the estimator learns from what is true, not from rewards
        self.estimator_optimizer = torch.optim.Adam(
            actor.estimator.parameters(), lr=s.estimator_rate, fused=True
        )
        self._half = max(1, torch.get_num_threads() // 2)
        self._beside = ThreadPoolExecutor(
            1, "critic", initializer=torch.set_num_threads, initargs=(self._half,)
        )
        self.estimator_batches = s.estimator_batches
        self._critic_epochs = s.critic_epochs
        self.return_scale = ReturnScale(env.num_envs, s.gamma) if s.normalise_returns else None
        self._rates = [self.learning_rate] * (s.epochs * s.mini_batches)
        """The learning rate at each of the actor's steps in the last update"""
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

    def learn(self, env: GaitEnv) -> dict[str, float]:
        """Collect one rollout and update; returns mean losses. Raises what :meth:`update` does."""
        obs = env.get_observations()
        with self._two_halves():
            with torch.inference_mode():
                for _ in range(self.storage.num_transitions_per_env):
                    obs, rewards, dones, extras = env.step(self.act(obs))
                    self.process_env_step(obs, rewards, dones, extras)
                self.compute_returns(obs)
            return self.update()

    def act(self, obs: TensorDict) -> Tensor:
        """Actions (envs, 12) with exploration; remembers what the update needs."""
        actor, fold, kept = self.policy, self.policy.fold, self.transition
        turned = fold.mirrored(obs["policy"])
        beside = self._beside.submit(self._value, obs, turned)
        with self._precision():
            actor_input = actor.with_estimate(fold.observation(obs["policy"], turned))
            mean = actor.mlp(actor_input).float()
        actor.distribution.update(mean)
        kept.actions = actor.distribution.sample()
        kept.actions_log_prob = actor.distribution.log_prob(kept.actions)
        judged, true, kept.values = beside.result()
        kept.distribution_params = (mean,)
        kept.observations = TensorDict(
            {"policy": actor_input, "critic": judged, "estimate": true}, obs.batch_size
        )
        kept.hidden_states = (None, None)
        return fold.action(kept.actions, turned)

    def _value(self, obs: TensorDict, turned: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """What the critic sees and what the estimator should, folded, and the critic's value."""
        with torch.inference_mode(), self._precision():  # a thread has its own of both
            judged = self._critic_fold.observation(obs["critic"], turned)
            true = self.policy.fold.estimate(obs["estimate"], turned)
            return judged, true, self.critic.mlp(judged).float()

    def process_env_step(
        self, obs: TensorDict, rewards: Tensor, dones: Tensor, extras: dict[str, Tensor]
    ) -> None:
        if self.return_scale is not None:
            rewards = self.return_scale(rewards, dones)
        super().process_env_step(obs, rewards, dones, extras)

    def compute_returns(self, obs: TensorDict) -> None:
        with self._precision():
            super().compute_returns(obs)

    def update(self) -> dict[str, float]:
        """Epochs of PPO over the rollout, and one pass of the estimator over it.

        Raises Failure if ten updates in a row changed nothing for want of finite gradients.
        """
        order = torch.randperm(self.storage.rewards.numel())
        batches = collected(self.storage, order).batches(self.num_mini_batches)
        judged, shared = self._critic_epochs, self.num_learning_epochs - self._critic_epochs
        rates = self._rates  # of the update before: _improve collects new ones meanwhile
        # in `batches` the estimates stay those that the actions were drawn from
        beside = self._beside.submit(
            lambda: (self._judge(judged * batches, rates), self._estimate(order))
        )
        acting = self._improve(
            judged * [[batch] for batch in batches]
            + shared * [batch.batches(2) for batch in batches]
        )
        judging, estimating = beside.result()
        self.storage.clear()

        self.skipped_steps += acting.skipped + judging.skipped + estimating.skipped
        lost = acting.skipped == acting.steps or judging.skipped == judging.steps
        self._lost_updates = self._lost_updates + 1 if lost else 0
        if self._lost_updates >= 10:
            raise Failure("training diverged: ten updates in a row had no finite gradients")
        surrogate, entropy = acting.losses
        return {
            "surrogate": surrogate, "value": judging.losses[0], "entropy": entropy,
            "estimator": estimating.losses[0],
        }  # fmt: skip

    def _improve(self, batches: list[list[Samples]]) -> StepReport:
        """The actor's steps (Schulman et al. 2017); its losses: surrogate and entropy.

        A batch is in one part or in two, of which the thread beside takes the second.
        """
        old_deviation = self.policy.distribution.std[0].detach().clone()
        optimizer_step = OptimizerStep(self.optimizer, self.max_grad_norm)
        rates = []
        for parts in batches:
            optimizer_step.begin()
            rows = sum(len(part.action) for part in parts)
            calls = [(part, len(part.action) / rows, old_deviation) for part in parts]
            beside = [self._beside.submit(self._surrogate, *call) for call in calls[1:]]
            told = self._surrogate(*calls[0]) + sum(part.result() for part in beside)
            surrogate, entropy, divergence = told
            self._follow_divergence(float(divergence))
            rates.append(self.learning_rate)
            optimizer_step.apply(surrogate, entropy)
        self._rates = rates
        return optimizer_step.end()

    def _surrogate(self, batch: Samples, share: float, old_deviation: Tensor) -> Tensor:
        """Adds to the actor's gradient; ``share`` x surrogate, entropy and divergence (3,)."""
        distribution = copy(self.policy.distribution)  # which remembers what it was updated with
        with self._precision():
            mean = self.policy.mlp(batch.actor_input).float()
        distribution.update(mean)
        ratio = (distribution.log_prob(batch.action) - batch.log_prob[:, 0]).exp()
        advantage = batch.advantage[:, 0]
        bounded = ratio.clamp(1 - self.clip_param, 1 + self.clip_param)
        surrogate = -torch.minimum(advantage * ratio, advantage * bounded).mean()
        entropy = distribution.entropy.mean()
        (share * (surrogate - self.entropy_coef * entropy)).backward()
        with torch.no_grad():
            old, new = (batch.mean, old_deviation), (mean, distribution.std)
            divergence = distribution.kl_divergence(old, new).mean()
        return share * torch.stack([surrogate, entropy, divergence]).detach()

    def _judge(self, batches: list[Samples], rates: list[float]) -> StepReport:
        """The critic's steps, at the rates of the actor's steps of the update before.

        Not at its last one: within an update rates rise and then fall, and the last is half of the
        mean.
        """
        optimizer_step = OptimizerStep(self.critic_optimizer, self.max_grad_norm)
        # its epochs are the first of the actor's
        for batch, rate in zip(batches, rates[: len(batches)], strict=True):
            self.critic_optimizer.param_groups[0]["lr"] = rate
            with self._precision():
                value = self.critic.mlp(batch.critic_input).float()
            error = (value - batch.returns).square()
            if self.use_clipped_value_loss:
                near = batch.value + (value - batch.value).clamp(-self.clip_param, self.clip_param)
                error = torch.maximum(error, (near - batch.returns).square())
            loss = error.mean()
            optimizer_step.step(loss, loss)
        return optimizer_step.end()

    def _follow_divergence(self, divergence: float) -> None:
        """Lower the learning rate when the policy moves away too fast, raise it when too slowly."""
        if divergence > 2 * self.desired_kl:
            self.learning_rate /= 1.5
        elif 0 < divergence < self.desired_kl / 2:
            self.learning_rate *= 1.5
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate * group["factor"]

    def _estimate(self, order: Tensor) -> StepReport:
        """The estimator's steps, one pass over the rollout."""
        observed = self.storage.observations.flatten(0, 1)
        seen, true = (observed[name].index_select(0, order) for name in ("policy", "estimate"))
        own = seen[:, : self.policy.obs_dim]  # without the old estimate
        optimizer_step = OptimizerStep(self.estimator_optimizer, math.inf)
        for own_part, wanted in zip(
            own.chunk(self.estimator_batches), true.chunk(self.estimator_batches), strict=True
        ):
            with self._precision():
                estimate = self.policy.estimator(own_part).float()
            loss = estimate_loss(estimate, wanted)
            optimizer_step.step(loss, loss)
        return optimizer_step.end()

    @contextmanager
    def _two_halves(self) -> Iterator[None]:
        """Here this thread has half of the cores, and the one beside it the others.

        On two cores nothing is shared then: threads that are woken for an environment's small
        operations cost more than they help.
        """
        threads = torch.get_num_threads()
        torch.set_num_threads(self._half)
        try:
            yield
        finally:
            torch.set_num_threads(threads)

    def _precision(self) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=self.use_mixed_precision)

    def state(self) -> LearnerState:
        """Everything a resumed run needs to go on."""
        networks = super().save()
        return {
            "actor_state_dict": networks["actor_state_dict"],
            "critic_state_dict": networks["critic_state_dict"],
            "optimizer_state_dict": networks["optimizer_state_dict"],
            "critic_optimizer": self.critic_optimizer.state_dict(),
            "estimator_optimizer": self.estimator_optimizer.state_dict(),
            "return_scale": self.return_scale.state_dict() if self.return_scale else None,
            "rates": self._rates,
            "skipped": self.skipped_steps,
        }

    def restore(self, saved: LearnerState) -> None:
        super().load(dict(saved), None, strict=True)
        self.critic_optimizer.load_state_dict(saved["critic_optimizer"])
        self.estimator_optimizer.load_state_dict(saved["estimator_optimizer"])
        if self.return_scale is not None:
            self.return_scale.load_state_dict(saved["return_scale"] or {})
        # a new stage may have more or fewer steps an update
        self._rates = list(islice(cycle(saved["rates"]), len(self._rates)))
        self.learning_rate = saved["rates"][-1]
        self.skipped_steps = saved["skipped"]
