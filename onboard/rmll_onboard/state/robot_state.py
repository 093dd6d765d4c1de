"""What a robot measured, and what its joints are told; the same for every robot.

Joint arrays are (12,): legs FR, FL, RR, RL, within a leg hip, thigh, calf.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

JOINTS = 12
MODE_BRAKE = 0x00
"""The joint brakes electronically; gains and targets are ignored"""
MODE_SERVO = 0x0A
"""The joint follows tau + kp (q_target - q) + kd (dq_target - dq)"""
POS_STOP = 2.146e9
"""[rad] in place of a target: no position loop"""
VEL_STOP = 16000.0
"""[rad/s] in place of a target: no velocity loop"""


_twelve = partial(np.zeros, JOINTS)
_twelve_bytes = partial(np.zeros, JOINTS, np.uint8)
_three = partial(np.zeros, 3)


@dataclass(slots=True)
class MotorCommand:
    """What the twelve joints are told. As made: all brake."""

    mode: NDArray[np.uint8] = field(default_factory=_twelve_bytes)
    q: NDArray[np.float64] = field(default_factory=_twelve)
    """[rad]"""
    dq: NDArray[np.float64] = field(default_factory=_twelve)
    """[rad/s]"""
    tau: NDArray[np.float64] = field(default_factory=_twelve)
    """[N·m], on the wire in steps of 1/256 up to 128"""
    kp: NDArray[np.float64] = field(default_factory=_twelve)
    """[N·m/rad], on the wire in steps of 1/32 up to 1024"""
    kd: NDArray[np.float64] = field(default_factory=_twelve)
    """[N·m·s/rad], on the wire in steps of 1/16 up to 2048"""


@dataclass(slots=True)
class RobotState:
    """What the robot measured."""

    mode: NDArray[np.uint8] = field(default_factory=_twelve_bytes)
    q: NDArray[np.float64] = field(default_factory=_twelve)
    """[rad]"""
    dq: NDArray[np.float64] = field(default_factory=_twelve)
    """[rad/s]"""
    tau: NDArray[np.float64] = field(default_factory=_twelve)
    """[N·m], estimated from the motor current"""
    temperature: NDArray[np.int8] = field(default_factory=partial(np.zeros, JOINTS, np.int8))
    """[°C]"""
    quaternion: NDArray[np.float64] = field(default_factory=partial(np.zeros, 4))
    """w, x, y, z: base to world"""
    gyro: NDArray[np.float64] = field(default_factory=_three)
    """[rad/s], base frame"""
    accelerometer: NDArray[np.float64] = field(default_factory=_three)
    """[m/s²], base frame"""
    rpy: NDArray[np.float64] = field(default_factory=_three)
    """[rad], the board's own roll, pitch, yaw"""
    foot_force: NDArray[np.int16] = field(default_factory=partial(np.zeros, 4, np.int16))
    """Raw units, FR FL RR RL"""
    tick: int = 0
    """The board's clock: milliseconds in practice, microseconds by the SDK's header"""
    remote: bytes = bytes(40)
    """The wireless remote, see :mod:`rmll_onboard.protocol.a1_remote`"""


class Streams(NamedTuple):
    """Which of the streams that not every robot has there are."""

    accelerometer: bool
    rpy: bool
    feet: bool = False
