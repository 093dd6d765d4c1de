"""What the board measures: joints, IMU and feet, with the faults of real sensors."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

from dataclasses import dataclass, fields

import mujoco
import numpy as np
from numpy.typing import NDArray

from rmll_hil.robot.world import World
from rmll_onboard.state.robot_state import RobotState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Strength of each sensor's faults. Standard deviations, and assumptions, but for the bias.

    No source gives the noise of the A1's encoders or IMU; these are ordinary figures for 15-bit
    encoders and a MEMS IMU.
    """

    joint_position: float = 0.0005
    """[rad]"""
    joint_velocity: float = 0.05
    """[rad/s]"""
    joint_torque: float = 0.2
    """[N·m]"""
    gyro: float = 0.02
    """[rad/s]"""
    gyro_bias: float = 0.005
    """[rad/s], constant in a run"""
    accelerometer: float = 0.1
    """[m/s²]"""
    attitude: float = 0.003
    """[rad] about each axis, of the board's orientation filter"""
    foot_gain_spread: float = 0.1
    """Largest relative deviation of a foot's gain"""
    foot_force: float = 1.0
    """Raw units"""
    foot_drift: float = 0.5
    """Raw units after one second, growing with the square root of time"""
    foot_noise_share: float = 0.0
    """Noise of the feet that grows with their unit: a share of a quarter of the robot's weight"""


QUIET = Noise(*[0.0] * len(fields(Noise)))
"""Sensors without faults, but for the feet's own bias and creep"""

# The feet report raw units, not newtons. The biases are at-rest values logged on an A1 (mybotshop
# forum); gain, creep and its time constant are assumptions. The rubber of a foot gives way under
# load and recovers slowly, so an unloaded foot reads below its bias (Cerberus, issue 2).
FOOT_BIAS = np.array([-1.06, -1.70, -20.86, -5.18])
FOOT_GAIN = 2.0
"""Raw units per newton, unless :class:`FootUnits` says another"""
FOOT_CREEP = 0.1
FOOT_CREEP_TIME = 0.2
"""[s]"""


@dataclass(frozen=True)
class FootUnits:
    """What the feet's raw readings mean, which no data sheet says. Four numbers, or one for all."""

    gain: float | tuple[float, float, float, float] | None = None
    """Raw units per newton; None: FOOT_GAIN"""
    bias: float | tuple[float, float, float, float] = 0.0
    """Raw units, on top of FOOT_BIAS"""
    drift: float | tuple[float, float, float, float] = 0.0
    """Raw units per second, for all time"""


MOTOR_TEMPERATURE = 35
"""[°C]; heating is not emulated"""


class Sensors:
    """Reads a :class:`World` as the board would; all randomness comes from ``rng``."""

    def __init__(
        self,
        world: World,
        noise: Noise,
        rng: np.random.Generator,
        units: FootUnits = FootUnits(),
    ) -> None:
        self._world = world
        self._noise = noise
        self._rng = rng
        self._gyro_bias = rng.normal(0, noise.gyro_bias, 3)
        standing = world.weight / 4
        self.feet = FootSensors(noise, units, rng, world.foot_load, standing)
        self._read_ms = 0

    def read(self, mode: NDArray[np.uint8], now_ms: int) -> RobotState:
        """One measurement of everything; ``mode`` is the motors' own."""
        world, noise, rng = self._world, self._noise, self._rng
        seconds = (now_ms - self._read_ms) * 1e-3
        self._read_ms = now_ms
        quaternion = _tilted(world.quaternion, rng.normal(0, noise.attitude, 3))
        return RobotState(
            mode=mode.copy(),
            q=world.q + rng.normal(0, noise.joint_position, 12),
            dq=world.dq + rng.normal(0, noise.joint_velocity, 12),
            tau=world.torque + rng.normal(0, noise.joint_torque, 12),
            temperature=np.full(12, MOTOR_TEMPERATURE, np.int8),
            quaternion=quaternion,
            gyro=world.gyro + self._gyro_bias + rng.normal(0, noise.gyro, 3),
            accelerometer=world.accelerometer + rng.normal(0, noise.accelerometer, 3),
            rpy=roll_pitch_yaw(quaternion),
            foot_force=self.feet.read(world.foot_load, seconds),
            tick=now_ms,
        )


class FootSensors:
    """Four force sensors in raw units: gain, creep, bias, drift and noise; 16-bit integers."""

    def __init__(
        self,
        noise: Noise,
        units: FootUnits,
        rng: np.random.Generator,
        load: Array,
        standing: float,
    ) -> None:
        """``load`` (4,) [N] is on them, ``standing`` [N] a quarter of the robot's weight."""
        self._noise = noise
        self._rng = rng
        gain = FOOT_GAIN if units.gain is None else np.array(units.gain)
        self.gain = gain * (1 + rng.uniform(-1, 1, 4) * noise.foot_gain_spread)
        """(4,) raw units per newton"""
        self.bias = FOOT_BIAS + np.array(units.bias)
        """(4,) raw units, now"""
        self._drift = np.array(units.drift)
        self._settled = load.copy()
        self._roughness = np.hypot(noise.foot_force, noise.foot_noise_share * standing * self.gain)

    def read(self, load: Array, seconds: float) -> NDArray[np.int16]:
        """``load`` [N], ``seconds`` since the last reading."""
        self._settled += (load - self._settled) * (1 - np.exp(-seconds / FOOT_CREEP_TIME))
        self.bias += self._rng.normal(0, self._noise.foot_drift * np.sqrt(seconds), 4)
        self.bias += self._drift * seconds
        felt = load + FOOT_CREEP * (load - self._settled)
        raw = self.gain * felt + self.bias + self._rng.normal(0, self._roughness)
        return np.rint(raw).clip(-32768, 32767).astype(np.int16)


def roll_pitch_yaw(quaternion: Array) -> Array:
    """[rad], turned in the order yaw, pitch, roll; ``quaternion`` is w, x, y, z."""
    w, x, y, z = quaternion
    return np.array(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ]
    )


def _tilted(quaternion: Array, angles: Array) -> Array:
    """``quaternion`` after small turns [rad] about the body's axes."""
    out = quaternion.copy()
    mujoco.mju_quatIntegrate(out, angles, 1.0)
    return out
