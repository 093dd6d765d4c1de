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
against the commands in :mod:`rmll_onboard.obedience`, the feet against the legs' torques where they
are calibrated.
"""

from collections.abc import Sequence
from math import asin, cos, exp, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.a1_wire import RobotState
from rmll_onboard.settings import Safety
from rmll_robots import Robot

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

GRAVITY = 9.81
"""[m/s²]"""
MEMORY = 0.25
"""[s] after which a disagreement of angles has faded to a third"""
LYING, MOVING = 0.25, 2.0
"""[s] over which the accelerometer is averaged"""
IN_A_WALK = 3.0
"""So many times the limit of a lying robot, the accelerometer may be off in a walk"""
REST = 0.25
"""[s] of states before they say how the robot lies"""
_LONGEST = 0.0125
"""[s] between two states; beyond it a rate says too little of an angle"""
_RESTARTED = 1.0
"""[s] that no state takes; the board's clock was set anew"""
_FASTEST = 15.0
"""[rad/s] at which a base turns. A faster rate is taken for that, so that a single wrong reading
stays below the limit and ends no walk"""
_FASTEST_JOINT = 1.5
"""The same, times the robot's own limit of joint speeds"""
_TRAIL = 32
"""States kept, one of each four, to tell the motion since a value last changed"""
_TURNED = 0.05
"""[rad] of motion; values that stay the same meanwhile are doubted"""
_NEEDED = "orientation", "gyroscope", "joint angles", "joint speeds", "joint torques"
"""What policy and guard cannot do without"""
_SPARE = "accelerometer", "rpy"


class Streams(NamedTuple):
    """Which of the streams that not every robot has there are."""

    accelerometer: bool
    rpy: bool
    feet: bool = False


class SensorMonitor:
    """Fed with every new state; then its attributes and properties tell what is wrong."""

    def __init__(self, robot: Robot, safety: Safety, streams: Streams, tick_seconds: float) -> None:
        """``tick_seconds`` is a count of the state's clock."""
        self._safety = safety
        self._streams = streams
        self._tick_seconds = tick_seconds
        self._tick: int | None = None
        self.attitude = Attitude()
        self.joints = Joints(robot)
        self.values = Values(robot, streams, safety)
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


class Attitude:
    """Orientation, gyroscope, accelerometer and the board's angles; in plain numbers, for NumPy
    takes longer for so few."""

    def __init__(self) -> None:
        self.drift = 0.0
        """[rad] that orientation and gyroscope have drifted apart"""
        self.rpy_error = 0.0
        """[rad] between the orientation and the board's roll, pitch and yaw"""
        self.gravity_error = 0.0
        """[m/s²] between the accelerometer's mean and what the orientation lets expect"""
        self.length = 0.0
        """Of the quaternion"""
        self._quaternion = 1.0, 0.0, 0.0, 0.0
        self._gyro: Vector = (0.0, 0.0, 0.0)
        self._apart: Vector = (0.0, 0.0, 0.0)
        self._felt: Vector = (0.0, 0.0, 0.0)
        self._excess: Vector = (0.0, 0.0, 0.0)
        self._unweighed = self._weighed = 0.0

    @property
    def known(self) -> bool:
        """The quaternion is a rotation."""
        return abs(self.length - 1) < 0.05

    def measure(self, dt: float, state: RobotState) -> None:
        """Hold the orientation against the gyroscope; ``dt`` [s] since the state before."""
        w, x, y, z = state.quaternion.tolist()
        gyro = state.gyro.tolist()
        self._unweighed += dt
        self.length = length = sqrt(w * w + x * x + y * y + z * z)
        (a, b, c, d), self._quaternion = self._quaternion, (w, x, y, z)
        (old_x, old_y, old_z), self._gyro = self._gyro, gyro
        if not (0 < dt <= _LONGEST and length):
            return
        rate_x, rate_y, rate_z = gyro
        # the turn since then, in the base frame: twice the vector of conj(before) * now
        twice = 2 / length if a * w + b * x + c * y + d * z >= 0 else -2 / length
        half, fade = dt / 2, exp(-dt / MEMORY)
        apart_x, apart_y, apart_z = self._apart
        apart_x = apart_x * fade + twice * (a * x - b * w - c * z + d * y)
        apart_y = apart_y * fade + twice * (a * y + b * z - c * w - d * x)
        apart_z = apart_z * fade + twice * (a * z - b * y + c * x - d * w)
        apart_x -= half * (_bounded(rate_x) + _bounded(old_x))
        apart_y -= half * (_bounded(rate_y) + _bounded(old_y))
        apart_z -= half * (_bounded(rate_z) + _bounded(old_z))
        self._apart = apart_x, apart_y, apart_z
        self.drift = sqrt(apart_x * apart_x + apart_y * apart_y + apart_z * apart_z)

    def weigh(self, accelerometer: Array, seconds: float) -> None:
        """Hold the accelerometer's mean over so many ``seconds`` against gravity."""
        w, x, y, z = self._quaternion
        felt = accelerometer.tolist()
        dt, self._unweighed = self._unweighed, 0.0
        self._weighed += dt
        # at first a plain mean of what there is
        share = min(1.0, dt / min(seconds, self._weighed)) if dt > 0 else 0.0
        # what a robot at rest feels is what holds it up against gravity
        gravity = (
            GRAVITY * 2 * (w * y - x * z),
            GRAVITY * -2 * (w * x + y * z),
            GRAVITY * (x * x + y * y - w * w - z * z),
        )
        self._felt = _nearer(self._felt, felt, share)
        excess = [one + other for one, other in zip(felt, gravity, strict=True)]
        self._excess = _nearer(self._excess, excess, share)
        self.gravity_error = _norm(self._excess)

    def compare(self, rpy: Array) -> None:
        """Hold the orientation against roll, pitch and yaw [rad] of the same state."""
        roll, pitch, yaw = rpy.tolist()
        w, x, y, z = self._quaternion
        cr, sr = cos(roll / 2), sin(roll / 2)
        cp, sp = cos(pitch / 2), sin(pitch / 2)
        cy, sy = cos(yaw / 2), sin(yaw / 2)
        along = abs(
            w * (cr * cp * cy + sr * sp * sy)
            + x * (sr * cp * cy - cr * sp * sy)
            + y * (cr * sp * cy + sr * cp * sy)
            + z * (cr * cp * sy - sr * sp * cy)
        )
        # for the small angles that matter, twice the sine of the half is the angle
        self.rpy_error = 2 * sqrt(max(0.0, 1 - along * along))

    def rpy_text(self) -> str:
        return (
            f"the orientation is not that of the board's own roll, pitch and yaw, by "
            f"{2 * asin(self.rpy_error / 2):.2f} rad; are the quaternion's parts in "
            "another order?"
        )

    def gravity_text(self) -> str:
        felt = _norm(self._felt)
        if abs(felt - GRAVITY) > self.gravity_error / 2:
            return f"the accelerometer's mean is {felt:.2f} m/s², expected {GRAVITY}"
        angle = self.gravity_error / GRAVITY
        return f"orientation and accelerometer disagree by {angle:.2f} rad about where down is"


class Joints:
    """Angles against speeds, and joints that always read the same. Arrays are (12,)."""

    def __init__(self, robot: Robot) -> None:
        joints = len(robot.joint_names)
        self._names = robot.joint_names
        self._fastest = _FASTEST_JOINT * robot.velocity_limit
        # how far angles and integrated speeds are apart [rad]; then angles and speeds, newest
        # and before, which change places at every state; one product adds all of it up
        self._rows = np.zeros((5, joints))
        self._weights = np.zeros((2, 5))
        self._dt = 0.0
        self._newest = 0
        self._sum = np.zeros(joints)
        self._apart = self._rows[0]
        self.still_ms = 0.0
        """[ms] that one joint of a walking robot has read the same"""
        self._seen = np.zeros((2, joints))
        self._moved = np.zeros(joints)  # [ns] when each joint last read something else

    @property
    def drift(self) -> float:
        """[rad] that an angle and the integral of its speed are apart, at the worst joint"""
        return float(np.abs(self._apart).max())

    def measure(self, dt: float, state: RobotState) -> None:
        """``dt`` [s] since the state before."""
        newest = self._newest = 1 - self._newest
        rows = self._rows
        rows[1 + newest], rows[3 + newest] = state.q, state.dq
        speeds = rows[3 + newest]
        if speeds @ speeds > self._fastest**2:
            speeds.clip(-self._fastest, self._fastest, out=speeds)
        if not 0 < dt <= _LONGEST:
            return
        if dt != self._dt:
            self._weigh(dt)
        self._weights[newest].dot(rows, out=self._sum)
        self._apart[:] = self._sum

    def disagreement(self, limit: float) -> str | None:
        """Of an angle and its speed, by more than ``limit`` [rad]."""
        apart = self._apart
        # most of the time not even all together are that far apart
        if apart @ apart <= limit * limit or self.drift <= limit:
            return None
        joint = int(np.abs(apart).argmax())
        return (
            f"{self._names[joint]}: its angle moved by {apart[joint]:+.2f} rad more than its speed "
            f"tells, within {MEMORY:g} s"
        )

    def watch(self, now: int, state: RobotState, walking: bool) -> None:
        """Look now and then whether a walking robot's joints read what they read before."""
        if not walking:
            self.still_ms = 0.0
            self._moved[:] = now
        else:
            q, dq = self._seen
            np.copyto(self._moved, now, where=(state.q != q) | (state.dq != dq))
            q[:], dq[:] = state.q, state.dq
            moved = self._moved
            self.still_ms = (now - float(moved[moved.argmin()])) / 1e6

    def still(self, limit_ms: float) -> str | None:
        """A joint of a walking robot that has read the same for longer."""
        if self.still_ms <= limit_ms:
            return None
        return f"{self._names[self._moved.argmin()]} has read the same for {self.still_ms:.0f} ms"

    def _weigh(self, dt: float) -> None:
        self._dt = dt
        fade, half = exp(-dt / MEMORY), dt / 2
        self._weights[0] = fade, 1, -1, -half, -half
        self._weights[1] = fade, -1, 1, -half, -half


class Values:
    """Which stay the same although the robot moves; each group of them alone."""

    def __init__(self, robot: Robot, streams: Streams, safety: Safety) -> None:
        self.needed: str | None = None
        """What is told of a group that the robot needs"""
        self.spare: tuple[str, str] | None = None
        """The group, and what is told of it, of those that it can do without"""
        self._names = [*_NEEDED, *(name for name in _SPARE if getattr(streams, name))]
        self._patience = safety.frozen_ms * 1e6
        groups = len(self._names)
        self._last = [b""] * groups
        self._changed = [0] * groups  # [ns] when each group last changed
        self._count = [0] * groups  # looks since then
        self._row = 0
        self._q = np.zeros((_TRAIL, len(robot.joint_names)))
        self._quaternion = np.zeros((_TRAIL, 4))

    def measure(self, now: int, state: RobotState) -> None:
        """Compare with the values of the last look."""
        row = self._row = (self._row + 1) % _TRAIL
        self._q[row], self._quaternion[row] = state.q, state.quaternion
        last, changed, count = self._last, self._changed, self._count
        self.needed = self.spare = None
        for group, array in enumerate(self._arrays(state)):
            data = array.tobytes()
            if data != last[group]:
                last[group], changed[group], count[group] = data, now, 0
                continue
            count[group] += 1
            if now - changed[group] > self._patience:
                self._tell(group, now)

    def _arrays(self, state: RobotState) -> Sequence[NDArray]:
        arrays = state.quaternion, state.gyro, state.q, state.dq, state.tau
        spare = (getattr(state, name) for name in self._names[len(_NEEDED) :])
        return *arrays, *spare

    def _tell(self, group: int, now: int) -> None:
        if (turned := self._turned(self._count[group])) <= _TURNED:
            return
        age = (now - self._changed[group]) / 1e6
        name = self._names[group]
        text = (
            f"{name}: the same values for {age:.0f} ms, in which the robot turned by "
            f"{turned:.2f} rad"
        )
        if group < len(_NEEDED):
            self.needed = self.needed or text
        else:
            self.spare = self.spare or (name, text)

    def _turned(self, looks: int) -> float:
        """[rad] in the last looks: the joint, or the base, that turned most."""
        row, then = self._row, self._row - min(looks, _TRAIL - 1)
        joints = float(np.abs(self._q[row] - self._q[then]).max())
        new, old = self._quaternion[row], self._quaternion[then]
        # both signs are the same orientation
        base = 2 * float(min(np.abs(new - old).max(), np.abs(new + old).max()))
        return max(joints, base)


def _bounded(rate: float) -> float:
    return _FASTEST if rate > _FASTEST else -_FASTEST if rate < -_FASTEST else rate


def _norm(vector: Vector) -> float:
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def _nearer(mean: Vector, value: Sequence[float], share: float) -> Vector:
    """``mean``, moved by a share of the way to ``value``."""
    (x, y, z), (to_x, to_y, to_z) = mean, value
    return x + share * (to_x - x), y + share * (to_y - y), z + share * (to_z - z)
