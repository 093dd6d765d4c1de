"""What gets harder as the robots learn: the ground under each of them, and what is asked of all."""

import torch
from torch import Tensor

from rmll_train.env.terrain import Terrain
from rmll_train.train_settings import EnvSettings, GroundSettings

START_LEVELS = 3
"""Robots begin on the first levels"""
SPOT = 1.0
"""[m] around a tile's middle within which a robot is placed"""


class TerrainCurriculum:
    """Each robot's tile. Without a terrain every robot stands on the same flat spot."""

    def __init__(
        self,
        terrain: Terrain | None,
        ground: GroundSettings,
        robots: int,
        generator: torch.Generator,
    ):
        self._terrain, self._generator = terrain, generator
        self._count, columns = terrain.centres.shape[:2] if terrain else (1, 1)
        self._harder_above = ground.harder_above
        start = min(START_LEVELS, self._count)
        self.level = torch.randint(start, (robots,), generator=generator)
        self._column = torch.arange(robots) % columns

    def update(self, ids: Tensor, whole: Tensor, fell: Tensor, adherence: Tensor) -> None:
        """After episodes of ``ids``: which came to their end, which fell, their adherence (n,).

        A robot that broke another limit stays: with exploration that happens on any ground.
        """
        done = whole & (adherence > self._harder_above)
        level = self.level[ids] + done.long() - fell.long()
        # who masters the last level is sent anywhere, so that no level is forgotten
        anywhere = torch.randint(self._count, level.shape, generator=self._generator)
        self.level[ids] = torch.where(level >= self._count, anywhere, level.clamp(min=0))

    def spots(self, ids: Tensor) -> Tensor:
        """Where to place these robots, x and y (n, 2) [m]."""
        if self._terrain is None:
            return torch.zeros(len(ids), 2)
        centres = self._terrain.centres[self.level[ids], self._column[ids]]
        return centres + (torch.rand(centres.shape, generator=self._generator) * 2 - 1) * SPOT


class GaitCurriculum:
    """What is asked of all robots alike, moved by how well they walk."""

    _STATE = "cost_scale", "adherence", "progress"
    RATE = 1.0016
    """Factor on the cost_scale from one policy step to the next: tenfold in 29 s of walking"""
    MEMORY = 50
    """Policy steps over which the adherence is averaged. A run's very first ones are full of
    transitions that nobody made: of robots that begin in the pose which their state waits for"""

    def __init__(self, world: EnvSettings):
        self._world = world
        self.cost_scale = world.rewards.cost_scale[0]
        """Factor on all costs of R_walk"""
        self.adherence = 0.0
        """Of late, see ``MEMORY``"""
        self.progress = 0.0 if world.rewards.strict_above_adherence > 0 else 1.0
        """Highest adherence so far as a share of that from which on the demands are strict"""

    @property
    def strict(self) -> bool:
        """The limits hold, and ``EnvSettings.on_violation`` says what reject edges do."""
        return self.progress >= 1.0

    @property
    def clearance(self) -> float:
        """[m] from which on a foot counts as in the air"""
        return self._grown(self._world.first_clearance, self._world.clearance)

    @property
    def gravity(self) -> float:
        """Share of the earth's"""
        return self._grown(self._world.first_gravity, 1.0)

    def _grown(self, first: float, last: float) -> float:
        return first + (last - first) * self.progress

    def state_dict(self) -> dict[str, float]:
        return {name: getattr(self, name) for name in self._STATE}

    def load_state_dict(self, saved: dict[str, float]) -> None:
        if "pressure" in saved:  # as it was called in checkpoints of older versions
            saved = {"cost_scale": saved["pressure"], **saved}
        for name in self._STATE:
            setattr(self, name, saved[name])

    def update(self, adherence: float, vx_error: float, steps: int) -> None:
        """After a rollout of so many policy steps with these means over all robots."""
        settings = self._world.rewards
        low, high = settings.cost_scale
        holds = adherence > settings.hold_adherence and vx_error < settings.hold_vx_error
        factor = self.RATE ** (steps if holds else -steps)
        self.cost_scale = min(high, max(low, self.cost_scale * factor))
        self.adherence += (adherence - self.adherence) * min(1.0, steps / self.MEMORY)
        if not self.strict:
            self.progress = max(
                self.progress, min(1.0, self.adherence / settings.strict_above_adherence)
            )
