"""Twelve actuators and an IMU on CAN as one robot: the same states and commands as an A1's.

The actuators answer each command with what they measured at that moment; the IMU sends by itself.
A datagram is what :mod:`rmll_onboard.protocol.can_frame` packs.
"""

from collections.abc import Sequence

import numpy as np

from rmll_onboard.control.contact_estimator import ContactEstimator
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.interface.packet_counter import PacketCounter
from rmll_onboard.protocol import can_imu, mit_packets
from rmll_onboard.protocol.can_frame import Frame, unpack
from rmll_onboard.protocol.mit_packets import MitCommands
from rmll_onboard.settings.can_settings import Can
from rmll_onboard.settings.runtime_settings import Feet
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MODE_SERVO, MotorCommand, RobotState, Streams
from rmll_robots import Robot

ENTER_ROUNDS = 3
"""How often, at least, the actuators are told to switch on before they are believed to be"""

_IMU = -1


class CanInterface(PacketCounter):
    """Both directions of the wire.

    A state is whole once every actuator and the IMU have been heard, all actuators after they were
    told to switch on. From then on it is new if anything in it is, and who has been silent for too
    long or reports an error is a fault.
    """

    streams = Streams(accelerometer=False, rpy=False, feet=False)
    farewell = 2.0
    """Until a robot lies, for the actuators then go limp"""
    tick_seconds = 1e-3
    """Of the IMU's clock"""

    def __init__(self, can: Can, robot: Robot) -> None:
        """Raises InputError if the actuators do not fit the robot."""
        super().__init__(RobotState())
        self.fault: str | None = None
        self._robot = robot
        layout = self._layout = Layout(can, robot)
        joints = len(layout.joints)
        self.state.mode[:] = MODE_SERVO
        self._timeout = int(can.reply_timeout_ms * 1e6)
        self._who = {
            (bus, reply_id, first): joint
            for joint, (bus, reply_id) in enumerate(zip(layout.bus, layout.reply_id, strict=True))
            for first in mit_packets.first_bytes(layout.id[joint], layout.variant[joint])
        }
        self._steps = np.zeros((3, joints))
        self._errors = [0] * joints
        self._heard: list[int | None] = [None] * (joints + 1)
        """[ns] when each actuator, and at the end the IMU, was heard last"""
        self._orientation: bytes | None = None
        self._rounds = 0
        self._complete = False

    @property
    def rejected(self) -> int:
        """Frames with the identifier of an actuator or the IMU that were none of theirs."""
        return self.refused.total() - self.refused[Reason.REPEATED]

    @property
    def missing(self) -> str:
        """Who has not been heard yet."""
        silent = [self._name(who) for who, when in enumerate(self._heard) if when is None]
        return ", ".join(silent)

    def contact_estimator(self, feet: Feet) -> ContactEstimator:
        """By torques."""
        return ContactEstimator(feet, self._robot, sensors=False)

    def take(self, now: int, datagrams: Sequence[bytes], resting: bool) -> bool:
        """Look for something new in ``datagrams``, whose frames are all of this moment."""
        believed = 0
        for datagram in datagrams:
            try:
                frames = unpack(datagram)
            except BadPacket as bad:
                self.refused[bad.reason] += 1
                continue
            for frame in frames:
                try:
                    believed += self._hear(now, frame)
                except BadPacket as bad:
                    self.refused[bad.reason] += 1
        self.only_broken = bool(datagrams) and not believed
        fresh = bool(believed) and self._update(now)
        self.lost += not fresh and self.received > 0
        if self._complete:
            self.fault = self.fault or self._trouble(now)
        return fresh

    def opening(self) -> bytes | None:
        """Every second one switches the actuators on, until all of them have answered.

        A command comes first, so that an actuator does not take up again what it was told before.
        """
        if self._complete:
            return None
        self._rounds += 1
        if self._rounds % 2:
            return None
        return self._layout.frames([mit_packets.ENTER] * len(self._layout.joints))

    def encode(self, command: MotorCommand) -> bytes:
        """The datagram for a command.

        The mode is left out, for these actuators have no brake. A joint without kp gets no target.
        """
        layout = self._layout
        position = np.where(command.kp > 0, layout.to_actuator(command.q), 0.0)
        return layout.frames(
            mit_packets.encode_commands(
                layout.ranges,
                MitCommands(
                    position,
                    layout.sign * command.dq,
                    command.kp,
                    command.kd,
                    layout.sign * command.tau,
                ),
            )
        )

    def _hear(self, now: int, frame: Frame) -> bool:
        """Take a frame; whether it is one of ours. Raises BadPacket."""
        bus, identifier, data = frame
        imu_bus, imu_id = self._layout.imu
        if bus == imu_bus and identifier in (imu_id, imu_id + 1):
            self._hear_imu(now, identifier == imu_id, data)
            return True
        joint = self._who.get((bus, identifier, data[0])) if data else None
        if joint is None:
            return False
        reply = mit_packets.decode_reply(data, self._layout.variant[joint])
        self._steps[:, joint] = reply[:3]
        self.state.temperature[joint] = reply.temperature
        self._errors[joint] = reply.error
        self._heard[joint] = now
        return True

    def _hear_imu(self, now: int, first: bool, data: bytes) -> None:
        """A sample counts when its second frame comes, and only if its clock has gone on."""
        if len(data) != can_imu.LENGTH:
            raise BadPacket(Reason.LENGTH)
        if first:
            self._orientation = data
            return
        if self._orientation is None:
            raise BadPacket(Reason.REPEATED)
        quaternion, gyro, milliseconds = can_imu.decode(self._orientation, data)
        self._orientation = None
        passed = (milliseconds - self.state.tick) & 0xFFFF
        if self._heard[-1] is not None and not passed:
            raise BadPacket(Reason.REPEATED)
        self.state.quaternion[:] = quaternion
        self.state.gyro[:] = gyro
        self.state.tick += passed
        self._heard[-1] = now

    def _update(self, now: int) -> bool:
        """Make a state of what has been heard; whether it is a whole one."""
        state, layout = self.state, self._layout
        if not self._complete:
            switched_on = self._rounds >= 2 * ENTER_ROUNDS
            if not switched_on or self._silent(now) is not None:
                return False
            self._complete = True
        position, velocity, torque = mit_packets.measured(layout.ranges, self._steps)
        state.q[:] = layout.to_joint(position)
        np.multiply(layout.sign, velocity, out=state.dq)
        np.multiply(layout.sign, torque, out=state.tau)
        imu = state.quaternion.tobytes() + state.gyro.tobytes()
        self._accepted(now, self._steps.tobytes() + imu)
        return True

    def _silent(self, now: int) -> int | None:
        """Index of the first one that has not been heard for too long."""
        for who, heard in enumerate(self._heard):
            if heard is None or now - heard > self._timeout:
                return who
        return None

    def _trouble(self, now: int) -> str | None:
        for joint, error in enumerate(self._errors):
            if error:
                known = mit_packets.ERRORS[self._layout.variant[joint]]
                return f"{self._name(joint)} reports error {error}: {known.get(error, 'unknown')}"
        silent = self._silent(now)
        if silent is None:
            return None
        return f"{self._name(silent)} has been silent for more than {self._timeout / 1e6:g} ms"

    def _name(self, who: int) -> str:
        joints = self._layout.joints
        return f"actuator {joints[who]}" if who < len(joints) else "the IMU"
