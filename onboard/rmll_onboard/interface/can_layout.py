"""Who is who on a robot's CAN buses, and how its actuators sit in its joints."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from rmll_common.errors import InputError
from rmll_onboard.protocol.can_frame import Frame, pack
from rmll_onboard.protocol.mit_packets import Ranges, Variant
from rmll_onboard.settings.can_settings import Can
from rmll_robots import Robot


class Layout:
    """Lists and arrays have an entry a joint, in the robot's order.

    Raises InputError if the actuators do not fit the robot.
    """

    def __init__(self, can: Can, robot: Robot) -> None:
        joints = robot.joint_names
        if set(can.actuators) != set(joints):
            odd = sorted(set(can.actuators) ^ set(joints))[0]
            raise InputError(
                f"can: actuators: {odd!r} is {'unknown' if odd in can.actuators else 'missing'}; "
                f"{robot.name} has {', '.join(joints)}"
            )
        actuators = [can.actuators[joint] for joint in joints]
        models = [can.models[actuator.model] for actuator in actuators]
        buses = list(can.buses)
        self._buses = len(buses)
        self.joints = joints
        self.bus = [buses.index(actuator.bus) for actuator in actuators]
        self.id = [actuator.id for actuator in actuators]
        self.variant: list[Variant] = [model.reply for model in models]
        self.reply_id = [actuator.reply_id for actuator in actuators]
        self.imu = buses.index(can.imu.bus), can.imu.id
        self.sign = np.array([actuator.sign for actuator in actuators], np.float64)
        self.offset = np.array([actuator.offset for actuator in actuators])
        self.ranges = Ranges(
            *(
                np.array([getattr(model, name) for model in models])
                for name in ("position", "velocity", "torque", "kp", "kd")
            )
        )
        self._check_reach(robot)
        self._check_gains(robot)

    def _check_reach(self, robot: Robot) -> None:
        for limit in (robot.joint_lower, robot.joint_upper):
            beyond = np.abs(self.to_actuator(limit)) > self.ranges.position
            if beyond.any():
                at = int(np.argmax(beyond))
                raise InputError(
                    f"can: actuator {self.joints[at]}: the joint's limit of {limit[at]:.4g} rad is "
                    f"{self.to_actuator(limit)[at]:.4g} rad at the actuator, beyond its "
                    f"{self.ranges.position[at]:g}"
                )

    def _check_gains(self, robot: Robot) -> None:
        needed = {"kp": max(robot.kp, robot.stand_kp), "kd": max(robot.kd, robot.stand_kd)}
        for name, gain in needed.items():
            largest = getattr(self.ranges, name)
            if (largest < gain).any():
                at = int(np.argmin(largest))
                raise InputError(
                    f"can: actuator {self.joints[at]}: {name} up to {largest[at]:g}, "
                    f"{robot.name} needs {gain:g}"
                )

    def to_actuator(self, q: NDArray) -> NDArray:
        """Actuators' angles of joint angles [rad]; speeds and torques only take the sign."""
        return self.sign * (q - self.offset)

    def to_joint(self, position: NDArray) -> NDArray:
        """Joint angles of actuators' angles [rad]."""
        return self.sign * position + self.offset

    def frames(self, data: Iterable[bytes]) -> bytes:
        """A datagram with a frame for each actuator."""
        return pack(map(Frame, self.bus, self.id, data))

    def answers(self) -> list[set[int]]:
        """For each bus, the identifiers of replies and of the IMU."""
        found = self._by_bus(self.reply_id)
        bus, first = self.imu
        found[bus] |= {first, first + 1}
        return found

    def commands(self) -> list[set[int]]:
        """For each bus, the identifiers of commands; on one bus they are none of an answer."""
        return self._by_bus(self.id)

    def _by_bus(self, identifiers: Sequence[int]) -> list[set[int]]:
        found: list[set[int]] = [set() for _ in range(self._buses)]
        for bus, identifier in zip(self.bus, identifiers, strict=True):
            found[bus].add(identifier)
        return found
