"""Orientation, gyroscope, accelerometer and the board's own angles, held against each other."""

from collections.abc import Sequence
from math import asin, cos, exp, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.state.attitude import GRAVITY
from rmll_onboard.state.robot_state import RobotState

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

MEMORY = 0.25
"""[s] after which a disagreement of angles has faded to a third"""
LONGEST = 0.0125
"""[s] between two states; beyond it a rate says too little of an angle"""
_FASTEST = 15.0
"""[rad/s] at which a base turns. A faster rate is taken for that, so that a single wrong reading
stays below the limit and ends no walk"""


class AttitudeMonitor:
    """Orientation, gyroscope, accelerometer and the board's angles; in plain numbers, for NumPy
    takes longer for so few."""

    def __init__(self) -> None:
        self.drift = 0.0
        """[rad] that orientation and gyroscope have drifted apart"""
        self.rpy_error = 0.0
        """[rad] between the orientation and the board's roll, pitch and yaw"""
        self.gravity_error = 0.0
        """[m/s²] between the accelerometer's mean and what the orientation lets expect"""
        self.length = 0.0
        """Of the quaternion"""
        self._quaternion = 1.0, 0.0, 0.0, 0.0
        self._gyro: Vector = (0.0, 0.0, 0.0)
        self._apart: Vector = (0.0, 0.0, 0.0)
        self._felt: Vector = (0.0, 0.0, 0.0)
        self._excess: Vector = (0.0, 0.0, 0.0)
        self._unweighed = self._weighed = 0.0

    @property
    def known(self) -> bool:
        """The quaternion is a rotation."""
        return abs(self.length - 1) < 0.05

    def measure(self, dt: float, state: RobotState) -> None:
        """Hold the orientation against the gyroscope; ``dt`` [s] since the state before."""
        w, x, y, z = state.quaternion.tolist()
        gyro = state.gyro.tolist()
        self._unweighed += dt
        self.length = length = sqrt(w * w + x * x + y * y + z * z)
        (a, b, c, d), self._quaternion = self._quaternion, (w, x, y, z)
        (old_x, old_y, old_z), self._gyro = self._gyro, gyro
        if not (0 < dt <= LONGEST and length):
            return
        rate_x, rate_y, rate_z = gyro
        # the turn since then, in the base frame: twice the vector of conj(before) * now
        twice = 2 / length if a * w + b * x + c * y + d * z >= 0 else -2 / length
        half, fade = dt / 2, exp(-dt / MEMORY)
        apart_x, apart_y, apart_z = self._apart
        apart_x = apart_x * fade + twice * (a * x - b * w - c * z + d * y)
        apart_y = apart_y * fade + twice * (a * y + b * z - c * w - d * x)
        apart_z = apart_z * fade + twice * (a * z - b * y + c * x - d * w)
        apart_x -= half * (_bounded(rate_x) + _bounded(old_x))
        apart_y -= half * (_bounded(rate_y) + _bounded(old_y))
        apart_z -= half * (_bounded(rate_z) + _bounded(old_z))
        self._apart = apart_x, apart_y, apart_z
        self.drift = sqrt(apart_x * apart_x + apart_y * apart_y + apart_z * apart_z)

    def weigh(self, accelerometer: Array, seconds: float) -> None:
        """Hold the accelerometer's mean over so many ``seconds`` against gravity."""
        w, x, y, z = self._quaternion
        felt = accelerometer.tolist()
        dt, self._unweighed = self._unweighed, 0.0
        self._weighed += dt
        # at first a plain mean of what there is
        share = min(1.0, dt / min(seconds, self._weighed)) if dt > 0 else 0.0
        # what a robot at rest feels is what holds it up against gravity
        gravity = (
            GRAVITY * 2 * (w * y - x * z),
            GRAVITY * -2 * (w * x + y * z),
            GRAVITY * (x * x + y * y - w * w - z * z),
        )
        self._felt = _nearer(self._felt, felt, share)
        excess = [one + other for one, other in zip(felt, gravity, strict=True)]
        self._excess = _nearer(self._excess, excess, share)
        self.gravity_error = _norm(self._excess)

    def compare(self, rpy: Array) -> None:
        """Hold the orientation against roll, pitch and yaw [rad] of the same state."""
        roll, pitch, yaw = rpy.tolist()
        w, x, y, z = self._quaternion
        cr, sr = cos(roll / 2), sin(roll / 2)
        cp, sp = cos(pitch / 2), sin(pitch / 2)
        cy, sy = cos(yaw / 2), sin(yaw / 2)
        along = abs(
            w * (cr * cp * cy + sr * sp * sy)
            + x * (sr * cp * cy - cr * sp * sy)
            + y * (cr * sp * cy + sr * cp * sy)
            + z * (cr * cp * sy - sr * sp * cy)
        )
        # for the small angles that matter, twice the sine of the half is the angle
        self.rpy_error = 2 * sqrt(max(0.0, 1 - along * along))

    def rpy_text(self) -> str:
        return (
            f"the orientation is not that of the board's own roll, pitch and yaw, by "
            f"{2 * asin(self.rpy_error / 2):.2f} rad; are the quaternion's parts in "
            "another order?"
        )

    def gravity_text(self) -> str:
        felt = _norm(self._felt)
        if abs(felt - GRAVITY) > self.gravity_error / 2:
            return f"the accelerometer's mean is {felt:.2f} m/s², expected {GRAVITY}"
        angle = self.gravity_error / GRAVITY
        return f"orientation and accelerometer disagree by {angle:.2f} rad about where down is"


def _bounded(rate: float) -> float:
    return _FASTEST if rate > _FASTEST else -_FASTEST if rate < -_FASTEST else rate


def _norm(vector: Vector) -> float:
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def _nearer(mean: Vector, value: Sequence[float], share: float) -> Vector:
    """``mean``, moved by a share of the way to ``value``."""
    (x, y, z), (to_x, to_y, to_z) = mean, value
    return x + share * (to_x - x), y + share * (to_y - y), z + share * (to_z - z)
