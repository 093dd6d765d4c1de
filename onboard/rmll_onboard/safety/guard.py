"""What must not be, as a table: one small check a row, and how often it may complain.

Every complaint that is kept up ends in damping. The limits are the settings' safety section.
Comparisons are written so that what is no number complains too.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.interface.robot_interface import RobotInterface
from rmll_onboard.safety.actuator_monitor import ActuatorMonitor
from rmll_onboard.safety.sensor_monitor import SensorMonitor
from rmll_onboard.settings.runtime_settings import Safety
from rmll_onboard.state import attitude
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import Robot

Array = NDArray[np.float64]

_ABSURD_SPEED = 100.0
"""[rad/s]; a measurement beyond it is an error of the sensor"""
_BROKEN_TICKS = 100
"""Over so many ticks the share of broken ones is averaged"""
_ON_TIME = 0.25
"""A tick in time makes up for so much of one that was left out"""
WILD = 2.0
"""So many times its range an action is no answer"""
_WARNINGS = 100


class SafetyInput(NamedTuple):
    """What a tick brought."""

    now: int
    """[ns], monotonic"""
    state: RobotState
    """The newest one"""
    fresh: bool
    """It is new"""
    gravity: Array
    """(3,) unit vector in the base frame"""
    moving: bool
    """The robot is not damped"""
    walking: bool


Check = Callable[[SafetyInput], str | None]


class PatientCheck:
    """A check that is believed after more than ``patience`` complaints; a content one in between
    takes one back, as in the A1's own library."""

    def __init__(self, check: Check, patience: float = 0) -> None:
        self._check = check
        self._patience = patience
        self._count = 0

    def __call__(self, seen: SafetyInput) -> str | None:
        complaint = self._check(seen)
        if complaint is None:
            if self._count:
                self._count -= 1
            return None
        self._count += 1
        return complaint if self._count > self._patience else None


class Guard:
    """All checks of the robot, the wire and the clock; cheap enough for every tick."""

    def __init__(
        self, robot: Robot, safety: Safety, interface: RobotInterface, period: int
    ) -> None:
        """``period`` [ns] is a tick's."""
        self.warnings: list[str] = []
        """What was no fault; the first hundred"""
        self.actuators = ActuatorMonitor(
            safety.torque_error, safety.actuator_ms * 1e6 / period, robot
        )
        self.sensors = SensorMonitor(robot, safety, interface.streams, interface.tick_seconds)
        self._names = robot.joint_names
        self._safety = safety
        self._interface = interface
        self._period = period
        self._middle = (robot.joint_upper + robot.joint_lower) / 2
        self._reach = (robot.joint_upper - robot.joint_lower) / 2
        # of the newest state, each looked at by two checks
        self._beyond = np.zeros(len(self._names))  # [rad] past the nearer limit, negative within
        self._speed = np.zeros(len(self._names))  # [rad/s]
        self._before: int | None = None
        self._left_out = self._broken = 0.0
        self._warned = np.zeros(len(self._names), bool)
        self._doubted: set[str] = set()
        self._always = PatientCheck(self._stale), PatientCheck(self._wire), PatientCheck(self._late)
        self._measured = (
            *(
                PatientCheck(check)
                for check in (self._frozen, self._still, self._tilted, self._impossible)
            ),
            *(
                PatientCheck(check, safety.patience)
                for check in (self._near, self._fast, self._power, self._heat, self._senses)
            ),
            *(PatientCheck(check) for check in (self._mode, self._torque)),
        )

    def complaint(self, seen: SafetyInput) -> str | None:
        """The first fault of this tick; to be called at every one, so that the rows can count.

        What was measured is judged when it is new; later only its age counts.
        """
        if seen.fresh:
            self.actuators.measure(seen.state)
            self.sensors.measure(seen.now, seen.state, seen.moving, seen.walking)
            self._beyond = np.abs(seen.state.q - self._middle) - self._reach
            self._speed = np.abs(seen.state.dq)
        rows = self._always + self._measured if seen.fresh else self._always
        complaints = [row(seen) for row in rows]
        return next(filter(None, complaints), None)

    def warn(self, text: str) -> None:
        """Keep what is no fault, but should be known."""
        if len(self.warnings) < _WARNINGS and text not in self.warnings:
            self.warnings.append(text)

    def _stale(self, seen: SafetyInput) -> str | None:
        age = (seen.now - self._interface.heard) / 1e6
        if age <= self._safety.stale_ms:
            return None
        return f"no state from the robot for {age:.0f} ms ({self._interface.refusals})"

    def _wire(self, seen: SafetyInput) -> str | None:
        self._broken += (self._interface.only_broken - self._broken) / _BROKEN_TICKS
        if self._broken <= self._safety.broken_share:
            return None
        return f"{self._broken:.0%} of the ticks bring broken datagrams only"

    def _late(self, seen: SafetyInput) -> str | None:
        before, self._before = self._before, seen.now
        if before is None or not seen.moving:
            self._left_out = 0.0
            return None
        missed = round((seen.now - before) / self._period) - 1
        self._left_out = max(0.0, self._left_out + (missed if missed > 0 else -_ON_TIME))
        if self._left_out <= self._safety.missed_ticks:
            return None
        return f"deadlines missed: {self._left_out:.0f} ticks late"

    def _frozen(self, seen: SafetyInput) -> str | None:
        age = (seen.now - self._interface.changed) / 1e6
        if age <= self._safety.frozen_ms:
            return None
        return f"the robot's measurements have not changed for {age:.0f} ms"

    def _still(self, seen: SafetyInput) -> str | None:
        return self.sensors.joints.still(self._safety.joint_still_ms)

    def _senses(self, seen: SafetyInput) -> str | None:
        if seen.moving and (doubt := self.sensors.doubt):
            sensor, text = doubt
            if sensor not in self._doubted:
                self._doubted.add(sensor)
                self.warn(text)
        return self.sensors.fault

    def _tilted(self, seen: SafetyInput) -> str | None:
        roll, pitch = attitude.roll_pitch(seen.gravity)
        if abs(roll) <= self._safety.roll_limit and abs(pitch) <= self._safety.pitch_limit:
            return None
        if not np.isfinite(roll):
            return f"no orientation: its quaternion is {seen.state.quaternion.tolist()}"
        return f"tilted: roll {roll:.2f} rad, pitch {pitch:.2f} rad"

    def _impossible(self, seen: SafetyInput) -> str | None:
        joint = int(self._beyond.argmax())
        beyond = self._beyond[joint]
        if not beyond <= self._safety.joint_beyond:
            return f"{self._joint(joint, seen.state)}, {beyond:.2f} rad past its limit"
        if self._speed[self._speed.argmax()] <= _ABSURD_SPEED:
            return None
        return "joint speeds that no joint can have"

    def _near(self, seen: SafetyInput) -> str | None:
        if not seen.walking:
            return None
        joint = int(self._beyond.argmax())
        beyond = self._beyond[joint]
        if beyond <= -self._safety.joint_margin:
            return None
        limit = self._middle[joint] + np.copysign(
            self._reach[joint], seen.state.q[joint] - self._middle[joint]
        )
        return f"{self._joint(joint, seen.state)}, its limit is {limit:.2f} rad"

    def _fast(self, seen: SafetyInput) -> str | None:
        joint = int(self._speed.argmax())
        speed = self._speed[joint]
        if speed <= self._safety.joint_speed:
            return None
        return f"{self._names[joint]} turns at {speed:.1f} rad/s"

    def _power(self, seen: SafetyInput) -> str | None:
        power = float(np.abs(seen.state.tau) @ self._speed)
        return None if power <= self._safety.power else f"the motors take {power:.0f} W"

    def _heat(self, seen: SafetyInput) -> str | None:
        temperature = seen.state.temperature
        joint = int(temperature.argmax())
        if temperature[joint] < self._safety.temperature_warning:
            return None
        for hot in np.flatnonzero(
            (temperature >= self._safety.temperature_warning) & ~self._warned
        ):
            self._warned[hot] = True
            self.warn(f"{self._names[hot]} reached {temperature[hot]} °C")
        if temperature[joint] < self._safety.temperature_limit:
            return None
        return f"{self._names[joint]} is at {temperature[joint]} °C"

    def _mode(self, seen: SafetyInput) -> str | None:
        return self.actuators.mode(seen.state)

    def _torque(self, seen: SafetyInput) -> str | None:
        return self.actuators.torque()

    def _joint(self, joint: int, state: RobotState) -> str:
        return f"{self._names[joint]} at {state.q[joint]:.2f} rad"


class ActionGuard:
    """Whether the policy's answers are anything like those that it was trained to give.

    What is a little out of range is clipped, in training as here, and no reason to fall down.
    """

    def __init__(self, clip: float, patience: int) -> None:
        """``clip`` is the largest absolute action of the bundle's contract."""
        self._clip = clip
        self._patience = patience
        self._count = 0

    def complaint(self, action: NDArray[np.float32], target: Array) -> str | None:
        """Once a policy step: ``action`` (12,) as the network gave it, ``target`` (12,) [rad]."""
        largest = float(np.abs(action).max())
        if not np.isfinite(largest):
            return "the policy's action is no finite number"
        if not np.isfinite(target).all():
            return "the policy's joint targets are not finite"
        self._count = self._count + 1 if largest > WILD * self._clip else 0
        if self._count <= self._patience:
            return None
        return f"the policy's action is {largest:.3g}, its range {self._clip:g}"
