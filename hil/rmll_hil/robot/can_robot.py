"""The robot's end of CAN: twelve actuators and an IMU, each on its bus.

An actuator answers every frame for it at once, with what it measures at that moment, and obeys
only while it is switched on; the IMU sends whenever the emulator is asked for its state.
"""

from collections.abc import Callable

import numpy as np

from rmll_common.errors import InputError
from rmll_hil.robot.mit_actuator import SPECIAL, SWITCH_OFF, SWITCH_ON, MitActuator
from rmll_hil.robot.motor_board import BRAKE, SERVO
from rmll_hil.robot.robot_frames import BusFrame, imu_sample, join, split
from rmll_onboard.settings.can_settings import Can
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MotorCommand, RobotState
from rmll_robots import Robot


class CanRobot:
    """Speaks for an :class:`rmll_hil.robot.emulator.Emulator` whose robot has no board."""

    passive_kd = 0.0
    """[N·m·s/rad] of a joint that is switched off or has no commander: it is limp, as with bgkatz's
    firmware, which then takes zero for every command"""

    def __init__(self, can: Can, robot: Robot) -> None:
        """``can`` is how the robot is built; raises InputError if it is another robot."""
        if set(can.actuators) != set(robot.joint_names):
            joints = ", ".join(robot.joint_names)
            raise InputError(f"can: actuators: expected one for each of {joints}")
        buses = list(can.buses)
        mounted = [can.actuators[joint] for joint in robot.joint_names]
        self._mounted = [(buses.index(each.bus), each) for each in mounted]
        self._actuators = [MitActuator(can.models[each.model], each.id) for each in mounted]
        self._joint_at = {(bus, each.id): joint for joint, (bus, each) in enumerate(self._mounted)}
        self._imu = buses.index(can.imu.bus), can.imu.id
        self._sign = np.array([each.sign for each in mounted], float)
        self._offset = np.array([each.offset for each in mounted])
        self.errors = [0] * len(mounted)
        """What each actuator reports, a number of the wire's"""
        self.on = np.zeros(len(mounted), bool)
        """Which are switched on"""
        nothing = bytes.fromhex("8000800000000800")
        self._targets = [actuator.read(nothing) for actuator in self._actuators]
        self._answers: list[BusFrame] = []

    def hear(self, datagram: bytes, measure: Callable[[], RobotState]) -> MotorCommand:
        """Take frames and prepare the answers; what all actuators now do. Raises BadPacket."""
        called = []
        for bus, identifier, data in split(datagram):
            joint = self._joint_at.get((bus, identifier))
            if joint is None or len(data) != 8:
                continue
            called.append(joint)
            if data == SWITCH_ON:
                self.on[joint] = True
            elif data == SWITCH_OFF:
                self.on[joint] = False
            elif self.on[joint] and not data.startswith(SPECIAL):
                self._targets[joint] = self._actuators[joint].read(data)
        if not called:
            raise BadPacket(Reason.LENGTH)
        self._answers += self._replies(called, measure())
        return self._command()

    def tell(self, state: RobotState) -> bytes:
        """The answers that are due, and a sample of the IMU."""
        bus, identifier = self._imu
        imu = [(bus, identifier + number, data) for number, data in enumerate(imu_sample(state))]
        answers, self._answers = self._answers, []
        return join(answers + imu)

    def _replies(self, joints: list[int], state: RobotState) -> list[BusFrame]:
        """A joint turns by sign x the actuator's angle, from offset on."""
        q, sign = self._sign * (state.q - self._offset), self._sign
        measured = np.stack((q, sign * state.dq, sign * state.tau)).T.tolist()
        temperature = state.temperature.tolist()
        frames = []
        for joint in joints:
            bus, mounted = self._mounted[joint]
            data = self._actuators[joint].reply(
                measured[joint], temperature[joint], self.errors[joint], bool(self.on[joint])
            )
            frames.append((bus, mounted.reply_id, data))
        return frames

    def _command(self) -> MotorCommand:
        position, velocity, kp, kd, torque = np.array(self._targets).T
        return MotorCommand(
            mode=np.where(self.on, SERVO, BRAKE).astype(np.uint8),
            q=self._sign * position + self._offset,
            dq=self._sign * velocity,
            tau=self._sign * torque,
            kp=kp,
            kd=kd,
        )
