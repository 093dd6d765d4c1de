"""The faults of a plan that are the robot's own: its body, its board, its sensors, its remote."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

from typing import TypeVar

import numpy as np

from rmll_hil.robot import a1_joystick, fault_plan
from rmll_hil.robot.a1_board_packets import with_angle, with_clock_of
from rmll_hil.robot.fault_plan import Plan, PlannedFault
from rmll_hil.robot.motor_board import BRAKE_KD, SERVO, MotorBoard
from rmll_hil.robot.sensors import roll_pitch_yaw
from rmll_hil.robot.world import World, push
from rmll_onboard.state.robot_state import MotorCommand, RobotState
from rmll_robots import Robot

OTHER_PERIOD_MS = 2

AFault = TypeVar("AFault", bound=PlannedFault)


class FaultInjector:
    """Applies a plan. Times are of the robot's clock."""

    def __init__(self, plan: Plan, world: World, board: MotorBoard, robot: Robot) -> None:
        self._plan = plan
        self._world = world
        self._board = board
        self._robot = robot
        self._has_remote = any(
            isinstance(f, fault_plan.RemoteButtons | fault_plan.RemoteLost) for f in plan
        )
        self._stuck: dict[int, float] = {}
        self._frozen: dict[tuple[PlannedFault, str], np.ndarray] = {}
        self._random = np.random.default_rng(0)
        self._last = b""

    def before_step(self, now_ms: int) -> None:
        """The body's and the board's faults, once the board has set its motors."""
        if not self._plan:
            return
        world = self._world
        trunk = world.data.xfrc_applied[world.model.body("trunk").id]
        trunk[:3] = sum(
            (np.array(f.force) for f in self._active(fault_plan.Push, now_ms)), np.zeros(3)
        )
        for fault in self._plan:
            if isinstance(fault, fault_plan.Kick) and now_ms == round(fault.at * 1000):
                push(world, fault.velocity)
        for fault in self._active(fault_plan.OtherCommander, now_ms):
            if now_ms % OTHER_PERIOD_MS == 0:
                self._board.receive(self._pose_command(fault), now_ms)
        for fault in self._active(fault_plan.BrakedJoint, now_ms):
            joint = self._joint(fault.joint)
            self._board.mode[joint] = fault.mode
            world.data.ctrl[joint] = world.model.actuator_biasprm[joint, 1] = 0.0
            world.model.actuator_biasprm[joint, 2] = -BRAKE_KD

    def distort(self, state: RobotState, now_ms: int) -> None:
        """The sensors' faults, in place; ``state`` is finite before and after."""
        for fault in self._plan:
            if not fault.active(now_ms):
                continue
            match fault:
                case fault_plan.StuckJoint():
                    joint = self._joint(fault.joint)
                    state.q[joint] = self._stuck.setdefault(joint, state.q[joint])
                    state.dq[joint] = 0.0
                case fault_plan.WrongJoint():
                    joint = self._joint(fault.joint)
                    state.q[joint] += fault.q
                    state.dq[joint] += fault.dq
                    state.tau[joint] += fault.tau
                case fault_plan.HotJoint():
                    heat = fault.rate * (now_ms / 1000 - fault.at)
                    joint = self._joint(fault.joint)
                    state.temperature[joint] = min(127, state.temperature[joint] + heat)
                case fault_plan.FlippedImu():
                    w, x, y, z = state.quaternion
                    state.quaternion[:] = -x, w, z, -y  # half a turn about the robot's nose
                    state.rpy[:] = roll_pitch_yaw(state.quaternion)
                case fault_plan.WrongGyro():
                    state.gyro += fault.rate
                case fault_plan.FrozenSensor():
                    for name in fault.sensors:
                        values = _sensor(state, name)
                        values[:] = self._frozen.setdefault((fault, name), values.copy())
                case fault_plan.DeadSensor():
                    for name in fault.sensors:
                        _sensor(state, name)[:] = 0
                case fault_plan.DeadImu():
                    for name in ("gyroscope", "accelerometer", "rpy"):
                        _sensor(state, name)[:] = 0
                    state.quaternion[:] = 1, 0, 0, 0
                case fault_plan.WrongRpy():
                    state.rpy += fault.rpy
                case fault_plan.SwappedQuaternion():
                    state.quaternion[:] = state.quaternion[[1, 2, 3, 0]]
                case fault_plan.NoisyFeet():
                    state.foot_force[:] = self._random.integers(fault.low, fault.high + 1, 4)
                case fault_plan.DeadFoot():
                    state.foot_force[self._robot.foot_names.index(fault.foot)] = fault.reads
        if self._has_remote:
            state.remote = self._remote(now_ms)

    def rewrite(self, datagram: bytes, now_ms: int) -> bytes:
        """The faults that no state can express, on the datagram."""
        for fault in self._active(fault_plan.Frozen, now_ms):
            fresh, datagram = datagram, self._last or datagram
            if fault.clock_runs:
                datagram = with_clock_of(datagram, fresh)
        for fault in self._active(fault_plan.NanJoint, now_ms):
            datagram = with_angle(datagram, fault.joint, np.nan)
        self._last = datagram
        return datagram

    def _active(self, kind: type[AFault], now_ms: int) -> list[AFault]:
        return [fault for fault in self._plan if isinstance(fault, kind) and fault.active(now_ms)]

    def _joint(self, name: str) -> int:
        return self._robot.joint_names.index(name)

    def _pose_command(self, fault: fault_plan.OtherCommander) -> MotorCommand:
        robot = self._robot
        pose = robot.stand_pose if fault.pose == "stand" else robot.crouch_pose
        joints = len(pose)
        return MotorCommand(
            mode=np.full(joints, SERVO, np.uint8),
            q=pose.copy(),
            kp=np.full(joints, fault.kp),
            kd=np.full(joints, fault.kd),
        )

    def _remote(self, now_ms: int) -> bytes:
        if self._active(fault_plan.RemoteLost, now_ms):
            return bytes(a1_joystick.SIZE)
        held = self._active(fault_plan.RemoteButtons, now_ms)
        buttons = [name for fault in held for name in fault.buttons]
        last = held[-1] if held else fault_plan.RemoteButtons()
        return a1_joystick.press(*buttons, lx=last.lx, ly=last.ly, rx=last.rx, ry=last.ry)


_FIELDS = {
    "orientation": "quaternion",
    "gyroscope": "gyro",
    "joint_angles": "q",
    "joint_speeds": "dq",
    "joint_torques": "tau",
    "feet": "foot_force",
}


def _sensor(state: RobotState, name: str) -> np.ndarray:
    return getattr(state, _FIELDS.get(name, name))
