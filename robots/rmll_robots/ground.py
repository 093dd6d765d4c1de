"""The ground that robots are trained and emulated on, one height field made of square tiles.

Tiles lie in rows of equal difficulty; the columns are kinds of ground. Around them is a flat
margin, so that a robot that leaves its tile walks on. Heights are in [m].
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Heights = NDArray[np.float32]
Kind = Literal["rough", "uphill", "downhill", "stones"]
SPACING = 0.1
"""[m] between two samples (legged_gym's horizontal_scale)"""
MARGIN = 12.0
"""[m] of flat ground around the tiles"""
LEVELS = 10
"""as many as the paper's code has"""
_HFIELD = 1
"""MuJoCo's mjGEOM_HFIELD"""
_BASE = 0.1
"""[m] of solid ground below the lowest point; MuJoCo wants some"""
_CONTACT = 0.01, 1.0
"""MuJoCo's solref; its time constant [s] is half of the default. At that a foot that lands hard
sinks in by its radius, and then the field's prisms hold it from all sides, with up to 2 kN and for
up to a second (google-deepmind/mujoco#2883). MuJoCo takes no less than two physics steps, which
are 5 ms long in training"""
_ALONE = 1e6
"""solmix: what touches the ground does not soften it"""


@dataclass(frozen=True)
class Ground:
    """Flat without ``kinds``; else a tiled height field with a row of tiles for each level.

    The greatest values belong to the last level; the first has a tenth of them.
    """

    kinds: tuple[Kind, ...] = ()
    levels: int = LEVELS
    tile: float = 8.0
    """[m], side"""
    roughness: float = 0.06
    """[m] above and below the mean"""
    slope: float = 0.3
    """rise over run"""
    stone_step: float = 0.08
    """[m] between the highest stone and the gaps"""
    platform: float = 0.0
    """[m] side of a flat square in the middle of each tile, beside what its kind has there"""
    only: int | None = None
    """The one level to lay out instead of all, counted from 0"""


@dataclass(frozen=True)
class HeightField:
    """A height field centred on the world's origin, and where its tiles are."""

    heights: Heights
    """(samples along y, samples along x)"""
    centres: Heights
    """(levels, columns, 2) x, y of each tile's middle"""

    @property
    def radii(self) -> tuple[float, float]:
        """Half extents along x and y."""
        rows, columns = self.heights.shape
        return (columns - 1) * SPACING / 2, (rows - 1) * SPACING / 2

    @property
    def middle(self) -> float:
        """Height at the world's origin, of the sample next to it."""
        rows, columns = self.heights.shape
        return float(self.heights[rows // 2, columns // 2])


def course(kind: Kind, level: int) -> Ground:
    """One kind of ground at one level, for walks of 24 m from the middle in any direction.

    In the middle, where a lying robot has to stand up, it is flat.
    """
    return Ground(kinds=(kind,), tile=48.0, platform=1.0, only=level)


def build(ground: Ground, seed: int) -> HeightField:
    """Lay out a row of tiles for each level, one column for each of ``ground.kinds``."""
    rng = np.random.default_rng(seed)
    samples, margin = round(ground.tile / SPACING), round(MARGIN / SPACING)
    kinds = ground.kinds
    levels = range(ground.levels) if ground.only is None else (ground.only,)
    heights = np.zeros((len(kinds) * samples, len(levels) * samples), np.float32)
    centres = np.zeros((len(levels), len(kinds), 2), np.float32)
    for place, level in enumerate(levels):
        share = (level + 1) / ground.levels
        for column, kind in enumerate(kinds):
            rows = slice(column * samples, (column + 1) * samples)
            columns = slice(place * samples, (place + 1) * samples)
            tile = _KINDS[kind](ground, share, samples, rng)
            heights[rows, columns] = _flattened(tile, ground.platform)
            centres[place, column] = (place + 0.5) * ground.tile, (column + 0.5) * ground.tile
    centres -= np.array([len(levels), len(kinds)], np.float32) * np.float32(ground.tile) / 2
    return HeightField(np.pad(heights, margin), centres)


def lay(spec: Any, field: HeightField) -> None:
    """Put the field in the place of the geom ``floor`` of a MuJoCo model's MjSpec.

    MuJoCo scales heights to 0..1, and back by the size.
    """
    heights = field.heights
    low, high = float(heights.min()), float(heights.max())
    spec.add_hfield(
        name="ground", nrow=heights.shape[0], ncol=heights.shape[1],
        size=[*field.radii, max(high - low, 1e-6), _BASE],
        userdata=((heights - low) / max(high - low, 1e-6)).ravel().tolist(),
    )  # fmt: skip
    floor = spec.geom("floor")
    floor.type, floor.hfieldname = _HFIELD, "ground"
    floor.pos = [0.0, 0.0, low]
    floor.solref, floor.solmix = _CONTACT, _ALONE


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


def _flattened(tile: Heights, platform: float) -> Heights:
    """The tile with a square of mean height in its middle, ``platform`` [m] wide."""
    from_middle = np.abs(np.arange(len(tile)) - (len(tile) - 1) / 2) * SPACING
    inside = from_middle <= platform / 2
    square = inside[:, None] & inside[None, :]
    return np.where(square, tile[square].mean(), tile) if platform else tile


def _enlarge(coarse: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Linear interpolation of a square grid to ``samples`` points a side."""
    at, have = np.linspace(0, len(coarse) - 1, samples), np.arange(len(coarse))
    rows = np.array([np.interp(at, have, row) for row in coarse])
    return np.array([np.interp(at, have, column) for column in rows.T]).T


_KINDS: dict[Kind, Callable[[Ground, float, int, np.random.Generator], Heights]] = {
    "rough": _rough,
    "downhill": _slope,
    "uphill": _bowl,
    "stones": _stones,
}
