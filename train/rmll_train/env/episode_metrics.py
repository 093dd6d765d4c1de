"""Sums over robots and steps, and the project's metrics from them."""

from dataclasses import dataclass, fields

import torch
from torch import Tensor


@dataclass
class EpisodeMetrics:
    """Sums since the last :meth:`GaitEnv.take_metrics`, each (n,), one number a robot."""

    steps: Tensor
    transitions: Tensor
    allowed: Tensor
    """transitions that the frequency commands allowed"""
    off_spec: Tensor
    """steps whose label neither an edge nor a hold explains"""
    vx_error: Tensor
    wz_error: Tensor
    energy: Tensor
    """[J]"""
    distance: Tensor
    """[m]"""
    walk_reward: Tensor
    level: Tensor
    episodes: Tensor
    ends: Tensor
    """episodes that ended before their time"""
    falls: Tensor
    """of these, with the robot on the ground"""
    length: Tensor
    """[policy steps] of the ended episodes"""

    @classmethod
    def zeros(cls, robots: int) -> "EpisodeMetrics":
        return cls(**{field.name: torch.zeros(robots) for field in fields(cls)})

    def robot(self, index: int) -> "EpisodeMetrics":
        """The sums of one robot."""
        return EpisodeMetrics(
            **{name: sums[index : index + 1] for name, sums in vars(self).items()}
        )

    def metrics(self) -> dict[str, float]:
        """Means over all robots, under the names that every report of the project uses."""
        total = {name: float(sums.sum()) for name, sums in vars(self).items()}
        steps, episodes = max(total["steps"], 1.0), max(total["episodes"], 1.0)
        return {
            "adherence": total["transitions"] / max(total["allowed"], 1e-9),
            "off_spec_contact": total["off_spec"] / steps,
            "vx_error": total["vx_error"] / steps,
            "wz_error": total["wz_error"] / steps,
            "energy_per_metre": total["energy"] / max(total["distance"], 1e-3),
            "walk_reward": total["walk_reward"] / steps,
            "level": total["level"] / steps,
            "early_ends": total["ends"] / episodes,
            "falls": total["falls"],
            "episode_steps": total["length"] / episodes,
        }
