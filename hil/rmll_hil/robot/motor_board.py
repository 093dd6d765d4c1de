"""The robot's low-level board: twelve joint servos, and what it does when nobody commands it."""

from collections import deque

import numpy as np

from rmll_hil.robot.world import World
from rmll_onboard.state.robot_state import MotorCommand
from rmll_robots import Robot

SERVO, BRAKE = 10, 0
"""Modes of a motor, as Unitree's library and its users write them; others brake too"""
NO_POSITION, NO_VELOCITY = 2146000000.0, 16000.0
"""PosStopF and VelStopF of the vendor's comm.h in place of a target: that loop is off. What comes
over the wire is their nearest number of 32 bits"""
BRAKE_KD = 3.0
"""[N·m·s/rad] of a joint in brake mode. Assumption: no source gives the brake's strength; this is
what unitree_guide's and legged_control's passive modes use"""

_LARGEST_TARGET = 1e3
"""[rad], [rad/s]; a servo saturates long before it, and MuJoCo refuses controls beyond 1e10"""
_POS_STOP, _VEL_STOP = (float(np.float32(stop)) for stop in (NO_POSITION, NO_VELOCITY))


class MotorBoard:
    """Drives the motors of a :class:`World`. Times are in whole milliseconds of the world."""

    def __init__(
        self,
        world: World,
        robot: Robot,
        delay_ms: int,
        timeout_ms: int,
        passive_kd: float = BRAKE_KD,
    ) -> None:
        """Args:
        delay_ms: from the arrival of a command to its effect at the joints.
        timeout_ms: the joints brake when no command came for so long.
        passive_kd: [N·m·s/rad] of the brake.
        """
        self._world = world
        self._robot = robot
        self._delay_ms = delay_ms
        self._timeout_ms = timeout_ms
        self._passive_kd = passive_kd
        self._pending: deque[tuple[int, MotorCommand]] = deque()
        self._heard_ms = 0
        self.mode = np.full(len(robot.joint_names), BRAKE, np.uint8)
        self._sag, self._most = np.zeros((2, len(robot.joint_names)))
        self._force_range = world.model.actuator_forcerange.T
        self._brake()

    def receive(self, command: MotorCommand, now_ms: int) -> None:
        """Take a command that has just arrived."""
        self._heard_ms = now_ms
        self._pending.append((now_ms + self._delay_ms, command))

    def update(self, now_ms: int) -> None:
        """Set the actuators for the physics step that begins now."""
        while self._pending and self._pending[0][0] <= now_ms:
            self._apply(self._pending.popleft()[1])
        if now_ms - self._heard_ms > self._timeout_ms and self.mode.any():
            self._brake()
        self._limit()

    def _apply(self, command: MotorCommand) -> None:
        """The servo law: tau + kp (q_target - q) + kd (dq_target - dq).

        Every mode but the servo's brakes; the stop values switch the position or velocity loop
        off.
        """
        servo = command.mode == SERVO
        kp = np.where(servo & (command.q != _POS_STOP), command.kp, 0.0)
        kd = np.where(servo & (command.dq != _VEL_STOP), command.kd, 0.0)
        q = command.q.clip(-_LARGEST_TARGET, _LARGEST_TARGET)
        dq = command.dq.clip(-_LARGEST_TARGET, _LARGEST_TARGET)
        self.mode[:] = np.where(servo, SERVO, BRAKE)
        self._actuate(
            np.where(servo, command.tau + kp * q + kd * dq, 0.0),
            kp,
            np.where(servo, kd, self._passive_kd),
        )

    def _brake(self) -> None:
        self._pending.clear()
        self.mode[:] = BRAKE
        self._actuate(0.0, 0.0, self._passive_kd)

    def _actuate(self, control: np.ndarray | float, kp: np.ndarray | float, kd: np.ndarray | float):
        model = self._world.model
        self._world.data.ctrl[:] = control
        model.actuator_biasprm[:, 1] = np.negative(kp)
        model.actuator_biasprm[:, 2] = np.negative(kd)

    def _limit(self) -> None:
        """Torque limits at the present speed, of a motor with a linear characteristic.

        Full torque at standstill, none towards a motion that is at the speed limit already, and
        full torque against any motion (robot_lab's DCMotorCfg of the A1 has the same line).
        """
        limit, sag = self._robot.torque_limit, self._sag
        np.multiply(self._world.dq, limit / self._robot.velocity_limit, out=sag)
        np.subtract(limit, sag, out=self._most)
        np.subtract(-limit, sag, out=sag)
        # by two ufuncs each, in place: at every physics step clip() costs more than the physics
        np.maximum(self._most, 0.0, out=self._most)
        np.minimum(self._most, limit, out=self._force_range[1])
        np.minimum(sag, 0.0, out=sag)
        np.maximum(sag, -limit, out=self._force_range[0])
