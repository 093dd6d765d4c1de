"""Contact labels of all robots, from forces and clearances."""

import torch
from torch import Tensor

from rmll_gaits import label
from rmll_train.env.simulation import Simulation
from rmll_train.train_settings import EnvSettings


class Contacts:
    """The labelling function's state; flags are (n, 4) in FR, FL, RR, RL."""

    BUFFERS = ("threshold", "down", "touching", "clear", "label", "touched_before", "air_time")

    def __init__(self, robots: int, world: EnvSettings, dt: float):
        self._dt = dt
        self.threshold = torch.full((robots, 4), world.contact_force)
        """[N] above which a foot's contact is noticed"""
        self.down = torch.ones(robots, 4, dtype=torch.bool)
        self.touching = self.down.clone()
        """Pressed now or one policy step ago"""
        self.clear = ~self.down
        """High enough above the ground to count as in the air"""
        self.label = torch.full((robots,), label.NUM_LABELS - 1)
        self.touched_before = self.down.clone()
        self.air_time = torch.zeros(robots, 4)
        """[s] since the foot last touched"""

    def begin(self, ids: Tensor) -> None:
        """These robots stand on all feet."""
        for flags in (self.down, self.touching, self.touched_before):
            flags[ids] = True
        self.clear[ids] = False
        self.label[ids] = label.NUM_LABELS - 1
        self.air_time[ids] = 0.0

    def observe(self, simulation: Simulation, clearance: float) -> Tensor:
        """Update labels, with the ``clearance`` [m] that is wanted now; returns (n, 4) [s] in the
        air of feet that touch down now, else 0."""
        touched = simulation.foot_force > self.threshold
        # one step of memory: a foot that bounces off for 20 ms has not lifted
        self.touching = touched | self.touched_before
        self.touched_before = touched
        self.clear = simulation.foot_height >= clearance
        self.down = label.hysteresis(self.down, self.touching, self.clear)
        self.label = label.label(self.down.long())
        landed_after = self.air_time * self.touching
        self.air_time = (self.air_time + self._dt) * ~self.touching
        return landed_after
