"""What makes walking harder, in either world."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from rmll_robots.ground import Kind

PUSH_INTERVAL = 5.0
"""[s] of walking from one push to the next. legged_gym pushes every 15 s; a walk of 20 s is to see
more than one"""
PUSH_VELOCITY = 1.0
"""[m/s] largest change of the base's velocity along x and along y, as in legged_gym"""


@dataclass(frozen=True)
class Conditions:
    """Ground and pushes of all walks of an evaluation."""

    ground: Literal["flat", Kind] = "flat"
    """What the robot walks on: rough is random heights; uphill and downhill lead away from the
    start."""
    level: int = 5
    """How hard the ground is, from 0 to 9, as in training; without effect on flat ground."""
    pushes: bool = False
    """Push the robot every 5 s of walking, by up to 1 m/s along x and along y."""

    @property
    def title(self) -> str:
        """As part of a sentence, empty for undisturbed walks on flat ground."""
        ground = "" if self.ground == "flat" else f" on {self.ground} ground of level {self.level}"
        return ground + (" with pushes" if self.pushes else "")


class VelocityPush(NamedTuple):
    """A sudden change of the base's velocity."""

    at: float
    """[s] of walking"""
    velocity: tuple[float, float]
    """[m/s] along the world's x and y"""


def pushes(seed: int, seconds: float) -> list[VelocityPush]:
    """Those of one walk."""
    rng = np.random.default_rng([seed, 1])
    moments = np.arange(PUSH_INTERVAL, seconds, PUSH_INTERVAL)
    along = rng.uniform(-PUSH_VELOCITY, PUSH_VELOCITY, (len(moments), 2))
    return [
        VelocityPush(float(at), (float(x), float(y)))
        for at, (x, y) in zip(moments, along, strict=True)
    ]
