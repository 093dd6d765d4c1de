"""Sums over robots and steps, and the project's metrics from them."""

from dataclasses import dataclass


@dataclass
class Tally:
    """Plain sums, over all robots, since the last :meth:`GaitEnv.take_tally`."""

    steps: int = 0
    transitions: float = 0.0
    allowed: float = 0.0
    """transitions that the frequency commands allowed"""
    off_spec: float = 0.0
    """steps whose label neither an edge nor a hold explains"""
    vx_error: float = 0.0
    wz_error: float = 0.0
    energy: float = 0.0
    """[J]"""
    distance: float = 0.0
    """[m]"""
    walk_reward: float = 0.0
    level: float = 0.0
    episodes: int = 0
    ends: int = 0
    """episodes that ended before their time"""
    length: float = 0.0
    """[policy steps] of the ended episodes"""

    def metrics(self) -> dict[str, float]:
        """Means under the names that every report of the project uses."""
        steps = max(self.steps, 1)
        return {
            "adherence": self.transitions / max(self.allowed, 1e-9),
            "off_spec_contact": self.off_spec / steps,
            "vx_error": self.vx_error / steps,
            "wz_error": self.wz_error / steps,
            "energy_per_metre": self.energy / max(self.distance, 1e-3),
            "walk_reward": self.walk_reward / steps,
            "level": self.level / steps,
            "early_ends": self.ends / max(self.episodes, 1),
            "episode_steps": self.length / max(self.episodes, 1),
        }
