"""The trainer's view of the ground: heights below any number of points, as torch tensors."""

from dataclasses import dataclass

import torch
from torch import Tensor

from rmll_robots import ground
from rmll_robots.ground import SPACING, Ground, HeightField


@dataclass(frozen=True)
class Terrain:
    """The height field that all simulations share, and where its tiles are."""

    field: HeightField
    centres: Tensor
    """(levels, columns, 2) x, y of each tile's middle [m]"""

    def height(self, x: Tensor, y: Tensor) -> Tensor:
        """Ground height below points of any shape, exactly MuJoCo's triangles; edges extend."""
        field = torch.from_numpy(self.field.heights)
        radius_x, radius_y = self.field.radii
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


def build(settings: Ground, seed: int) -> Terrain:
    """The same heights as in the emulator, for the same settings and seed."""
    field = ground.build(settings, seed)
    return Terrain(field, torch.from_numpy(field.centres))
