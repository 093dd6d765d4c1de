"""What the robot may do at any moment: lie damped, stand up, stand, walk, sit down.

    damping -> standing up -> standing <-> walking
       ^           |             |            |
       +-----  sitting down  <---+------------+

Every fault ends in damping and stays there for as long as the process lives. Pure: time, state
and requests in, motor commands out. Joint arrays are (12,) in the robot's order.
"""

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.modes import NS, Mode, Request
from rmll_onboard.state.robot_state import MODE_SERVO, POS_STOP, MotorCommand, RobotState
from rmll_robots import Robot

Array = NDArray[np.float64]


class Supervisor:
    """Holds the mode and the fault, and turns both into motor commands."""

    def __init__(
        self,
        robot: Robot,
        settings: RuntimeSettings,
        walk_pose: Array,
        walk_gains: tuple[float, float],
        torque_limit: float,
    ) -> None:
        """``walk_pose`` [rad] is where walking starts, ``walk_gains`` are Kp and Kd of the policy;
        ``torque_limit`` [N·m] is the most that targets and gains may ask of a joint."""
        self.mode = Mode.DAMPING
        self.fault: str | None = None
        self._robot = robot
        self._settings = settings
        self._walk_pose = walk_pose
        self._walk_gains = walk_gains
        self._torque_limit = torque_limit
        self._motion = _PosePath(0, [(0.0, walk_pose)])
        self._command = MotorCommand()
        self._command.mode[:] = MODE_SERVO

    def update(
        self, now: int, state: RobotState, complaint: str | None, request: Request | None
    ) -> Mode:
        """Change the mode if time or the request says so, and trip if it has moving joints.

        Args:
            now: [ns], monotonic.
            state: the newest one, whatever its age.
            complaint: what is wrong, see :mod:`rmll_onboard.safety.guard`; it trips a robot that
                is not damped.
            request: the operator's wish, None for none; what the mode does not allow is ignored.
        """
        if self.fault:
            return self.mode
        arrived = now >= self._motion.end
        match self.mode, request:
            case Mode.DAMPING, Request.STAND:
                self._stand_up(now, state)
            case ((Mode.STANDING_UP | Mode.STANDING), Request.SIT):
                self._move(Mode.SITTING_DOWN, now, state, [self._sit_leg()])
            case Mode.WALKING, Request.SIT:
                legs = [self._plant_leg(), self._sit_leg()]
                self._move(Mode.SITTING_DOWN, now, state, legs)
            case Mode.WALKING, Request.STAND:
                self._move(Mode.STANDING, now, state, [self._plant_leg()])
            case Mode.STANDING, Request.WALK if arrived:
                self.mode = Mode.WALKING
            case Mode.STANDING_UP, _ if arrived:
                self.mode = Mode.STANDING
            case Mode.SITTING_DOWN, _ if arrived:
                self.mode = Mode.DAMPING
        if complaint and self.mode is not Mode.DAMPING:
            self.trip(complaint)
        return self.mode

    def trip(self, fault: str) -> None:
        """Into damping, for good; the first fault is the one that is told."""
        self.fault = self.fault or fault
        self.mode = Mode.DAMPING

    def command(self, now: int, state: RobotState, target: Array) -> MotorCommand:
        """The command of this instant; ``target`` [rad] is the policy's, used while walking.

        The command's arrays are reused by the next call.
        """
        if self.mode is Mode.DAMPING:
            return self.damping()
        if self.mode is Mode.WALKING:
            kp, kd = self._walk_gains
            wanted = target
        else:
            kp, kd = self._robot.stand_kp, self._robot.stand_kd
            if self.mode is Mode.STANDING_UP:
                kp *= self._motion.ramp(now)
            wanted = self._motion.at(now)
        return self._fill(self._safe(wanted, state, kp, kd), kp, kd)

    def damping(self) -> MotorCommand:
        """The command of a damped robot: no targets, only resistance to motion."""
        return self._fill(POS_STOP, 0.0, self._robot.damping_kd)

    def _stand_up(self, now: int, state: RobotState) -> None:
        motion = self._settings.motion
        legs = [
            (motion.crouch, self._robot.crouch_pose),
            (motion.rise, self._robot.stand_pose),
            (motion.settle, self._walk_pose),
        ]
        self._move(Mode.STANDING_UP, now, state, legs)

    def _plant_leg(self) -> tuple[float, Array]:
        """All feet to the ground, fast: a gait on two legs of one side tips over meanwhile."""
        return self._settings.motion.plant, self._walk_pose

    def _sit_leg(self) -> tuple[float, Array]:
        return self._settings.motion.sit, self._robot.crouch_pose

    def _move(
        self, mode: Mode, now: int, state: RobotState, legs: list[tuple[float, Array]]
    ) -> None:
        """Start from where the joints are, not from where they were told to be."""
        self.mode = mode
        self._motion = _PosePath(now, [(0.0, state.q.copy()), *legs])

    def _safe(self, wanted: Array, state: RobotState, kp: float, kd: float) -> Array:
        """The target nearest to ``wanted`` within joint limits and torque, the torque first."""
        robot, room = self._robot, self._torque_limit / kp
        # where the damping alone takes the joint; minimum and maximum, for clip() takes thrice as
        # long for so few
        middle = state.q + (kd / kp) * state.dq
        safe = np.minimum(np.maximum(wanted, robot.joint_lower), robot.joint_upper)
        return np.minimum(np.maximum(safe, middle - room), middle + room)

    def _fill(self, q: Array | float, kp: float, kd: float) -> MotorCommand:
        command = self._command
        command.q[:] = q
        command.kp[:] = kp
        command.kd[:] = kd
        return command


class _PosePath:
    """A path through poses, starting and ending each leg at rest."""

    def __init__(self, start: int, legs: list[tuple[float, Array]]) -> None:
        """``legs`` are (seconds to get there, pose), the first one with 0 seconds."""
        self._times = start + np.cumsum([seconds for seconds, _ in legs]) * NS
        self._poses = [pose for _, pose in legs]
        self.end = int(self._times[-1])

    def at(self, now: int) -> Array:
        """The pose of this instant; after the end, the last one."""
        leg = int(np.searchsorted(self._times, now, side="right"))
        if leg >= len(self._poses):
            return self._poses[-1]
        before, after = self._poses[leg - 1], self._poses[leg]
        return before + self._share(leg, now) * (after - before)

    def ramp(self, now: int) -> float:
        """Share of the first leg that is done, from a little above 0 to 1."""
        return max(0.01, self._share(1, now))

    def _share(self, leg: int, now: int) -> float:
        begin, end = self._times[leg - 1], self._times[leg]
        s = min(1.0, max(0.0, (now - begin) / (end - begin)))
        return s * s * (3 - 2 * s)
