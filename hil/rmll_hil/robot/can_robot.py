"""The robot's end of CAN: twelve actuators and an IMU, each on its bus.

An actuator answers every frame for it at once, with what it measures at that moment, and obeys
only while it is switched on; the IMU sends whenever the emulator is asked for its state.
"""

from collections.abc import Callable

import numpy as np

from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.protocol import can_imu, mit_packets
from rmll_onboard.protocol.can_frame import Frame, pack, unpack
from rmll_onboard.protocol.mit_packets import MitCommands, Reply
from rmll_onboard.settings.can_settings import Can
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MODE_BRAKE, MODE_SERVO, MotorCommand, RobotState
from rmll_robots import Robot

_SPECIAL = b"\xff" * 7


class CanRobot:
    """Speaks for an :class:`rmll_hil.robot.emulator.Emulator` whose robot has no board."""

    passive_kd = 0.0
    """[N·m·s/rad] of a joint that is switched off or has no commander: it is limp, as with bgkatz's
    firmware, which then takes zero for every command"""

    def __init__(self, can: Can, robot: Robot) -> None:
        """Raises InputError if the actuators do not fit the robot."""
        layout = self._layout = Layout(can, robot)
        joints = len(layout.joints)
        self.errors = [0] * joints
        """What each actuator reports, of :data:`rmll_onboard.protocol.mit_packets.ERRORS`"""
        self.on = np.zeros(joints, bool)
        """Which are switched on"""
        nothing = MitCommands(*np.zeros((5, joints)))
        self._told = mit_packets.encode_commands(layout.ranges, nothing)
        self._who = {
            key: joint for joint, key in enumerate(zip(layout.bus, layout.id, strict=True))
        }
        self._answers: list[Frame] = []

    def hear(self, datagram: bytes, measure: Callable[[], RobotState]) -> MotorCommand:
        """Take frames and prepare the answers; what all actuators now do. Raises BadPacket."""
        called = []
        for bus, identifier, data in unpack(datagram):
            joint = self._who.get((bus, identifier))
            if joint is None or len(data) != 8:
                continue
            called.append(joint)
            if data == mit_packets.ENTER:
                self.on[joint] = True
            elif data == mit_packets.EXIT:
                self.on[joint] = False
            elif self.on[joint] and not data.startswith(_SPECIAL):
                self._told[joint] = data
        if not called:
            raise BadPacket(Reason.LENGTH)
        self._answers += self._replies(called, measure())
        return self._command()

    def tell(self, state: RobotState) -> bytes:
        """The answers that are due, and a sample of the IMU."""
        bus, identifier = self._layout.imu
        sample = can_imu.encode(state.quaternion, state.gyro, state.tick)
        imu = [Frame(bus, identifier + number, data) for number, data in enumerate(sample)]
        answers, self._answers = self._answers, []
        return pack(answers + imu)

    def _replies(self, joints: list[int], state: RobotState) -> list[Frame]:
        layout = self._layout
        steps = mit_packets.measure(
            layout.ranges,
            layout.to_actuator(state.q),
            layout.sign * state.dq,
            layout.sign * state.tau,
        )
        frames = []
        for joint in joints:
            variant = layout.variant[joint]
            error = self.errors[joint]
            if variant == "damiao" and not self.on[joint]:
                error = error or mit_packets.OFF
            position, velocity, torque = steps[:, joint].tolist()
            reply = Reply(position, velocity, torque, int(state.temperature[joint]), error)
            data = mit_packets.encode_reply(layout.id[joint], reply, variant)
            frames.append(Frame(layout.bus[joint], layout.reply_id[joint], data))
        return frames

    def _command(self) -> MotorCommand:
        layout = self._layout
        told = mit_packets.decode_commands(layout.ranges, self._told)
        return MotorCommand(
            mode=np.where(self.on, MODE_SERVO, MODE_BRAKE).astype(np.uint8),
            q=layout.to_joint(told.position),
            dq=layout.sign * told.velocity,
            tau=layout.sign * told.torque,
            kp=told.kp,
            kd=told.kd,
        )
