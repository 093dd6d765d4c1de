"""Do the robot's sensors agree? Each stream is held against another one, for both wires here.

| stream | held against | if they disagree |
|---|---|---|
| orientation | the gyroscope's integral | a fault |
| joint angles | the integral of the joint speeds | a fault |
| orientation, gyroscope, angles, speeds, torques | the robot's own motion | a fault |
| orientation | gravity, by the accelerometer | no standing up; in a walk a warning |
| orientation | the board's own roll, pitch and yaw | no standing up; in a walk a warning |
| accelerometer, roll pitch yaw | the robot's own motion | a warning |

A fault is what blinds the policy or the guard; without the rest a robot can walk. Torques are held
against the commands in :mod:`rmll_onboard.safety.actuator_monitor`, the feet against the legs'
torques in :mod:`rmll_onboard.control.foot_calibration`.
"""

from rmll_onboard.safety.attitude_monitor import MEMORY, AttitudeMonitor
from rmll_onboard.safety.frozen_values import FrozenValues
from rmll_onboard.safety.joint_monitor import JointMonitor
from rmll_onboard.settings.runtime_settings import Safety
from rmll_onboard.state.robot_state import RobotState, Streams
from rmll_robots import Robot

LYING, MOVING = 0.25, 2.0
"""[s] over which the accelerometer is averaged"""
IN_A_WALK = 3.0
"""So many times the limit of a lying robot, the accelerometer may be off in a walk"""
REST = 0.25
"""[s] of states before they say how the robot lies"""
_RESTARTED = 1.0
"""[s] that no state takes; the board's clock was set anew"""
_SPARE = "accelerometer", "rpy"
"""What the robot can do without"""


class SensorMonitor:
    """Fed with every new state; then its attributes and properties tell what is wrong."""

    def __init__(self, robot: Robot, safety: Safety, streams: Streams, tick_seconds: float) -> None:
        """``tick_seconds`` is a count of the state's clock."""
        self._safety = safety
        self._streams = streams
        self._tick_seconds = tick_seconds
        self._tick: int | None = None
        self.attitude = AttitudeMonitor()
        self.joints = JointMonitor(robot)
        spare = [name for name in _SPARE if getattr(streams, name)]
        self.values = FrozenValues(robot, spare, safety)
        self._turn = 0
        self._rest = 0.0  # [s] of states since the robot last moved
        self._rest_began = 0  # [ns]

    def measure(self, now: int, state: RobotState, moving: bool, walking: bool) -> None:
        """A new state came, at ``now`` [ns]; ``moving``: the robot is not damped."""
        dt = self._passed(state.tick)
        if moving or not dt:
            self._rest, self._rest_began = 0.0, now
        else:
            self._rest += dt
        self.attitude.measure(dt, state)
        self.joints.measure(dt, state)
        # what has time is looked at in turn, so that no tick pays for all of it
        self._turn = (self._turn + 1) % 4
        if self._turn == 0:
            self.values.measure(now, state)
        elif self._turn == 1:
            self.joints.watch(now, state, walking)
        elif self._turn == 2 and self._streams.accelerometer:
            self.attitude.weigh(state.accelerometer, MOVING if moving else LYING)
        elif self._turn == 3 and self._streams.rpy:
            self.attitude.compare(state.rpy)

    def _passed(self, tick: int) -> float:
        """[s] since the state before; 0 if there was none, or the board's clock was set anew."""
        before, self._tick = self._tick, tick
        if before is None:
            return 0.0
        passed = (tick - before & 0xFFFFFFFF) * self._tick_seconds
        return passed if passed <= _RESTARTED else 0.0

    @property
    def fault(self) -> str | None:
        """What the robot must not move with."""
        if self.values.needed:
            return self.values.needed
        drift, limit = self.attitude.drift, self._safety.orientation_error
        if not drift <= limit:
            return f"orientation and gyroscope disagree by {drift:.2f} rad within {MEMORY:g} s"
        return self.joints.disagreement(self._safety.speed_error)

    @property
    def doubt(self) -> tuple[str, str] | None:
        """Of what a walking robot can do without: which sensor is wrong, and how."""
        safety, attitude = self._safety, self.attitude
        if attitude.rpy_error > safety.rpy_error:
            return "rpy", attitude.rpy_text()
        if attitude.gravity_error > IN_A_WALK * safety.gravity_error:
            return "accelerometer", attitude.gravity_text()
        return self.values.spare

    def unready(self, now: int) -> str | None:
        """Why a lying robot must not stand up, or not yet."""
        safety, attitude = self._safety, self.attitude
        if not attitude.known:
            return f"no orientation: its quaternion has the length {attitude.length:.2f}"
        passed = (now - self._rest_began) / 1e9
        if passed > 2 * REST and not 0.5 < self._rest / passed < 2:
            return (
                f"the board's clock went on by {self._rest:.3g} s in {passed:.3g} s; "
                "is link.tick_us right?"
            )
        if self._rest < REST:
            return f"no {REST:g} s of states in a row yet"
        if attitude.gravity_error > safety.gravity_error:
            return attitude.gravity_text()
        if attitude.rpy_error > safety.rpy_error:
            return attitude.rpy_text()
        return self.fault
