"""The ground: flat, or one tiled height field of ten levels that all simulations share.

Tiles lie in rows of equal difficulty; the columns are kinds of ground. Around them is a flat
margin, so that a robot that leaves its tile walks on. Heights are in [m].
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rmll_train.settings import Ground

Heights = NDArray[np.float32]
SPACING = 0.1
"""[m] between two samples (legged_gym's horizontal_scale)"""
MARGIN = 12.0
"""[m] of flat ground around the tiles"""


@dataclass(frozen=True)
class Terrain:
    """A height field centred on the world's origin, and where its tiles are."""

    heights: Heights
    """(samples along y, samples along x)"""
    centres: Tensor
    """(levels, columns, 2) x, y of each tile's middle"""

    @property
    def radii(self) -> tuple[float, float]:
        """Half extents along x and y."""
        rows, columns = self.heights.shape
        return (columns - 1) * SPACING / 2, (rows - 1) * SPACING / 2

    def height(self, x: Tensor, y: Tensor) -> Tensor:
        """Ground height below points of any shape, exactly MuJoCo's triangles; edges extend."""
        field = torch.from_numpy(self.heights)
        radius_x, radius_y = self.radii
        column = ((x + radius_x) / SPACING).clamp(0, field.shape[1] - 1.001)
        row = ((y + radius_y) / SPACING).clamp(0, field.shape[0] - 1.001)
        c, r = column.long(), row.long()
        u, v = column - c, row - r
        low, high = field[r, c], field[r + 1, c + 1]
        # each cell is two triangles, split along the diagonal from (r, c) to (r + 1, c + 1)
        right, left = field[r, c + 1], field[r + 1, c]
        below = low + u * (right - low) + v * (high - right)
        above = low + v * (left - low) + u * (high - left)
        return torch.where(u >= v, below, above)


def build(ground: Ground, seed: int) -> Terrain:
    """Lay out ``ground.levels`` rows of tiles, one column for each of ``ground.kinds``."""
    rng = np.random.default_rng(seed)
    samples, margin = round(ground.tile / SPACING), round(MARGIN / SPACING)
    levels, kinds = ground.levels, ground.kinds
    heights = np.zeros((len(kinds) * samples, levels * samples), np.float32)
    centres = torch.zeros(levels, len(kinds), 2)
    for level in range(levels):
        share = (level + 1) / levels
        for column, kind in enumerate(kinds):
            rows = slice(column * samples, (column + 1) * samples)
            columns = slice(level * samples, (level + 1) * samples)
            heights[rows, columns] = _KINDS[kind](ground, share, samples, rng)
            centres[level, column] = torch.tensor([level + 0.5, column + 0.5]) * ground.tile
    heights = np.pad(heights, margin)
    centres -= torch.tensor([levels, len(kinds)]) * ground.tile / 2
    return Terrain(heights, centres)


def _rough(ground: Ground, share: float, samples: int, rng: np.random.Generator) -> Heights:
    """legged_gym's random_uniform_terrain: random heights every 0.2 m, linear in between."""
    coarse = rng.uniform(-1, 1, (samples // 2 + 1, samples // 2 + 1))
    return (_enlarge(coarse, samples) * ground.roughness * share).astype(np.float32)


def _slope(ground: Ground, share: float, samples: int, rng: np.random.Generator) -> Heights:
    """A pyramid with a flat top, to be left downhill."""
    across = np.minimum(np.arange(samples), np.arange(samples)[::-1]) * SPACING
    distance = np.minimum(across[:, None], across[None, :])
    top = ground.tile / 2 - 1.0
    return (distance.clip(max=top) * ground.slope * share).astype(np.float32)


def _bowl(ground: Ground, share: float, samples: int, rng: np.random.Generator) -> Heights:
    """The pyramid upside down, to be left uphill."""
    return -_slope(ground, share, samples, rng)


def _stones(ground: Ground, share: float, samples: int, rng: np.random.Generator) -> Heights:
    """Square stones of different heights with gaps between them; flat in the middle."""
    side, gap = 5, 1
    count = samples // side + 1
    tops = rng.uniform(-0.5, 0.5, (count, count)) * ground.stone_step * share
    index = np.arange(samples)
    heights = tops[index // side][:, index // side]
    gaps = (index % side < gap)[:, None] | (index % side < gap)[None, :]
    heights = np.where(gaps, -ground.stone_step * share, heights)
    middle = np.abs(index - samples / 2) * SPACING < 0.6
    return np.where(middle[:, None] & middle[None, :], 0.0, heights).astype(np.float32)


def _enlarge(coarse: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Linear interpolation of a square grid to ``samples`` points a side."""
    at, have = np.linspace(0, len(coarse) - 1, samples), np.arange(len(coarse))
    rows = np.array([np.interp(at, have, row) for row in coarse])
    return np.array([np.interp(at, have, column) for column in rows.T]).T


_KINDS: dict[str, Callable[[Ground, float, int, np.random.Generator], Heights]] = {
    "rough": _rough,
    "downhill": _slope,
    "uphill": _bowl,
    "stones": _stones,
}
