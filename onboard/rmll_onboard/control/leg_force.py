"""How hard each foot presses, and how high it is, from what the joints of its leg do."""

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.state.modes import NS
from rmll_robots import Robot

Array = NDArray[np.float64]

_SHORTEST = 1_000_000
"""[ns] between two states; closer ones give no acceleration"""
_STRAIGHT, _LEVEL = 1e-4, 1e-3
"""[m²], [m]: a leg that is stretched out, or level with its hip, carries without any torque"""
_HIPS = range(0, 12, 3)
"""Index of each leg's first joint"""


class LegForce:
    """The vertical force of the ground on each foot, by the static law tau = -J^T f of a leg.

    What the joints need to accelerate the leg is taken off their torques first: in a swing it is
    as much as the robot's weight on a foot. Acceleration is the difference of two measured speeds.
    Thigh and calf accelerate each other; the hip is alone. The leg's weight, and the forces of its
    speeds, are left out: an error of a few newtons.
    """

    def __init__(self, robot: Robot) -> None:
        self._leg = robot.leg
        self._offsets = [
            robot.leg.hip_offset * (1 if foot.endswith("L") else -1) for foot in robot.foot_names
        ]
        self._dq = self._dq_before = [0.0] * len(robot.joint_names)
        self._then = self._then_before = -1
        self.heights = [0.0] * len(robot.foot_names)
        """[m] of each foot above its hip, against gravity, in the last :meth:`step`; negative"""

    def turn(self, now: int, dq: Array) -> None:
        """The joints' speeds (12,) [rad/s] of a state measured at ``now`` [ns]; of each new one."""
        self._dq_before, self._dq = self._dq, dq.tolist()
        self._then_before, self._then = self._then, now

    def step(self, q: Array, tau: Array, gravity: Array) -> list[float]:
        """Forces on the four feet [N], upwards positive, from the newest state.

        ``q`` [rad] and ``tau`` [N·m] are (12,), ``gravity`` is the unit vector (3,) in the base
        frame; all NaN in, all NaN out. A leg whose pose tells nothing gives 0.
        """
        passed = self._then - self._then_before
        known = self._then_before >= 0 and passed >= _SHORTEST
        rate = NS / passed if known else 0.0
        angles, torques, down = q.tolist(), tau.tolist(), gravity.tolist()
        self.heights, forces = [], []
        for first, offset in zip(_HIPS, self._offsets, strict=True):
            height, force = self._foot(first, offset, rate, angles, torques, down)
            self.heights.append(height)
            forces.append(force)
        return forces

    def _foot(
        self,
        hip: int,
        offset: float,
        rate: float,
        q: list[float],
        tau: list[float],
        gravity: list[float],
    ) -> tuple[float, float]:
        """Height and force of one leg, in plain numbers: NumPy takes longer for so few.

        In the plane of thigh and calf, x forwards and z along it upwards, two torques give two
        components of the force; the hip's torque then gives the one across the plane.
        """
        leg, dq, dq_before = self._leg, self._dq, self._dq_before
        thigh, calf = hip + 1, hip + 2
        side, swing, bend = q[hip], q[thigh], q[calf]
        hip_rate = rate * (dq[hip] - dq_before[hip])
        thigh_rate = rate * (dq[thigh] - dq_before[thigh])
        calf_rate = rate * (dq[calf] - dq_before[calf])
        shin = swing + bend
        calf_x, calf_z = -leg.calf * sin(shin), -leg.calf * cos(shin)
        x, z = calf_x - leg.thigh * sin(swing), calf_z - leg.thigh * cos(swing)
        down_y = gravity[1] * cos(side) + gravity[2] * sin(side)
        down_z = gravity[2] * cos(side) - gravity[1] * sin(side)
        height = -(gravity[0] * x + down_y * offset + down_z * z)
        bent = z * calf_x - x * calf_z
        if abs(bent) < _STRAIGHT or abs(z) < _LEVEL:
            return height, 0.0
        bend_inertia = leg.bend_inertia * cos(bend)
        both = leg.calf_on_thigh + bend_inertia
        tau_hip = tau[hip] - leg.hip_inertia * hip_rate
        tau_thigh = (
            tau[thigh] - (leg.thigh_inertia + 2 * bend_inertia) * thigh_rate - both * calf_rate
        )
        tau_calf = tau[calf] - both * thigh_rate - leg.calf_inertia * calf_rate
        # tau_thigh = x fz - z fx, tau_calf = calf_x fz - calf_z fx
        force_x = (x * tau_calf - calf_x * tau_thigh) / bent
        force_z = (z * tau_calf - calf_z * tau_thigh) / bent
        # tau_hip = z fy - offset fz
        force_y = (tau_hip + offset * force_z) / z
        return height, -(gravity[0] * force_x + down_y * force_y + down_z * force_z)
