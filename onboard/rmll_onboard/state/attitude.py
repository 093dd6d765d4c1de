"""Which way is down, from the robot's own orientation estimate."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81
"""[m/s²]"""


def projected_gravity(quaternion: Array) -> Array:
    """Unit vector of gravity (3,) in the base frame, (0, 0, -1) when level.

    ``quaternion`` (4,) is w, x, y, z, base to world. If it is no rotation, its length being off
    by more than 5 %, all NaN.
    """
    w, x, y, z = quaternion.tolist()
    square = w * w + x * x + y * y + z * z
    if not 0.9 < square < 1.1:
        return np.full(3, np.nan)
    gravity = 2 * (w * y - x * z), -2 * (w * x + y * z), x * x + y * y - w * w - z * z
    return np.array(gravity) / square


def roll_pitch(gravity: Array) -> tuple[float, float]:
    """Roll and pitch [rad] of a base that sees gravity so; NaN in, NaN out."""
    x, y, z = gravity.tolist()
    return math.atan2(-y, -z), math.asin(max(-1.0, min(1.0, x)))
