"""How hard each foot presses, from what the joints of its leg do."""

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
        joints = len(robot.joint_names)
        self._dq, self._acceleration = np.zeros(joints), np.zeros(joints)
        self._then: int | None = None

    def turn(self, now: int, dq: Array) -> None:
        """The joints' speeds (12,) [rad/s] of a state measured at ``now`` [ns]; of each new one."""
        if self._then is not None and now - self._then >= _SHORTEST:
            np.subtract(dq, self._dq, out=self._acceleration)
            self._acceleration *= NS / (now - self._then)
        self._then = now
        self._dq[:] = dq

    def step(self, q: Array, tau: Array, gravity: Array) -> list[float]:
        """Forces on the four feet [N], upwards positive, from the newest state.

        ``q`` [rad] and ``tau`` [N·m] are (12,), ``gravity`` is the unit vector (3,) in the base
        frame; all NaN in, all NaN out. A leg whose pose tells nothing gives 0.
        """
        angles, torques, down = q.tolist(), tau.tolist(), gravity.tolist()
        accelerations = self._acceleration.tolist()
        return [
            self._foot(
                offset,
                angles[first : first + 3],
                torques[first : first + 3],
                accelerations[first : first + 3],
                down,
            )
            for first, offset in zip(range(0, len(angles), 3), self._offsets, strict=True)
        ]

    def _foot(
        self,
        offset: float,
        q: list[float],
        tau: list[float],
        acceleration: list[float],
        gravity: list[float],
    ) -> float:
        """One leg, in plain numbers: NumPy takes longer for so few.

        In the plane of thigh and calf, x forwards and z along it upwards, two torques give two
        components of the force; the hip's torque then gives the one across the plane.
        """
        leg, (hip, thigh, calf) = self._leg, acceleration
        shin = q[1] + q[2]
        calf_x, calf_z = -leg.calf * sin(shin), -leg.calf * cos(shin)
        x, z = calf_x - leg.thigh * sin(q[1]), calf_z - leg.thigh * cos(q[1])
        bent = z * calf_x - x * calf_z
        if abs(bent) < _STRAIGHT or abs(z) < _LEVEL:
            return 0.0
        bend = leg.bend_inertia * cos(q[2])
        both = leg.calf_on_thigh + bend
        tau_hip = tau[0] - leg.hip_inertia * hip
        tau_thigh = tau[1] - (leg.thigh_inertia + 2 * bend) * thigh - both * calf
        tau_calf = tau[2] - both * thigh - leg.calf_inertia * calf
        # tau_thigh = x fz - z fx, tau_calf = calf_x fz - calf_z fx
        force_x = (x * tau_calf - calf_x * tau_thigh) / bent
        force_z = (z * tau_calf - calf_z * tau_thigh) / bent
        # tau_hip = z fy - offset fz
        force_y = (tau_hip + offset * force_z) / z
        down_y = gravity[1] * cos(q[0]) + gravity[2] * sin(q[0])
        down_z = gravity[2] * cos(q[0]) - gravity[1] * sin(q[0])
        return -(gravity[0] * force_x + down_y * force_y + down_z * force_z)
