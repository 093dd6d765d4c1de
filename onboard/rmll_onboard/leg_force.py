"""How hard each foot presses, from what the joints do: for robots without foot sensors."""

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.supervisor import NS
from rmll_robots import Robot

Array = NDArray[np.float64]

_SHORTEST = 1_000_000
"""[ns] between two states; closer ones give no acceleration"""
_STRAIGHT, _LEVEL = 1e-4, 1e-3
"""[m²], [m]: a leg that is stretched out, or level with its hip, carries without any torque"""


class LegForce:
    """The vertical force of the ground on each foot, by the static law tau = -J^T f of a leg.

    What a joint needs to accelerate itself is taken off its torque first: in a swing it is as
    much as a light contact. Acceleration is the difference of two measured speeds. The legs'
    weight and what the joints of a leg do to each other are left out; an error of a few newtons.
    """

    def __init__(self, robot: Robot) -> None:
        leg = robot.leg
        self._thigh, self._calf = leg.thigh, leg.calf
        self._offsets = [
            leg.hip_offset * (1 if foot.endswith("L") else -1) for foot in robot.foot_names
        ]
        self._inertia = np.tile(leg.inertia, len(robot.foot_names))
        self._dq = np.zeros(len(robot.joint_names))
        self._then: int | None = None

    def step(self, now: int, q: Array, dq: Array, tau: Array, gravity: Array) -> Array:
        """Forces (4,) [N], upwards positive, from a state measured at ``now`` [ns].

        ``q`` [rad], ``dq`` [rad/s] and ``tau`` [N·m] are (12,), ``gravity`` is the unit vector (3,)
        in the base frame; all NaN in, all NaN out. A leg whose pose tells nothing gives 0.
        """
        if self._then is not None and now - self._then >= _SHORTEST:
            tau = tau - self._inertia * (dq - self._dq) * (NS / (now - self._then))
        self._then = now
        self._dq[:] = dq
        return self.static(q, tau, gravity)

    def static(self, q: Array, tau: Array, gravity: Array) -> Array:
        """The same of joints that do not accelerate."""
        angles, torques, down = q.tolist(), tau.tolist(), gravity.tolist()
        return np.array(
            [
                self._foot(offset, angles[first : first + 3], torques[first : first + 3], down)
                for first, offset in zip(range(0, len(angles), 3), self._offsets, strict=True)
            ]
        )

    def _foot(self, offset: float, q: list[float], tau: list[float], gravity: list[float]) -> float:
        """One leg, in plain numbers: NumPy takes longer for so few.

        In the plane of thigh and calf, x forwards and z along it upwards, two torques give two
        components of the force; the hip's torque then gives the one across the plane.
        """
        shin = q[1] + q[2]
        calf_x, calf_z = -self._calf * sin(shin), -self._calf * cos(shin)
        x, z = calf_x - self._thigh * sin(q[1]), calf_z - self._thigh * cos(q[1])
        # tau_thigh = x fz - z fx, tau_calf = calf_x fz - calf_z fx
        bent = z * calf_x - x * calf_z
        if abs(bent) < _STRAIGHT or abs(z) < _LEVEL:
            return 0.0
        force_x = (x * tau[2] - calf_x * tau[1]) / bent
        force_z = (z * tau[2] - calf_z * tau[1]) / bent
        # tau_hip = z fy - offset fz
        force_y = (tau[0] + offset * force_z) / z
        down_y = gravity[1] * cos(q[0]) + gravity[2] * sin(q[0])
        down_z = gravity[2] * cos(q[0]) - gravity[1] * sin(q[0])
        return -(gravity[0] * force_x + down_y * force_y + down_z * force_z)
