"""A robot as the rest of the project sees it: names, limits, gains and poses."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """A hip that rolls, then a thigh and a calf that pitch; the same for all four."""

    hip_offset: float
    """[m] from the hip's axis outwards to the plane of thigh and calf"""
    thigh: float
    """[m]"""
    calf: float
    """[m] to the middle of the foot"""
    hip_inertia: float
    """[kg m²] that the hip turns in the standing pose, the motor's own included"""
    thigh_inertia: float
    """[kg m²] that the thigh turns, with the calf at a right angle to it"""
    calf_inertia: float
    """[kg m²] that the calf turns"""
    calf_on_thigh: float
    """[kg m²] by which one of the two accelerates the other, with the calf at a right angle"""
    bend_inertia: float
    """[kg m²] that the cosine of the calf's angle adds to the line above, and twice to the thigh's:
    the calf's mass times its middle's distance times the length of the thigh"""


@dataclass(frozen=True)
class Robot:
    """Facts of one quadruped. Joint arrays are (12,), in the order of ``joint_names``."""

    name: str
    joint_names: tuple[str, ...]
    foot_names: tuple[str, ...]
    """Leg order of every per-foot array, also the bit order of contact labels."""
    joint_lower: Array
    """[rad]"""
    joint_upper: Array
    """[rad]"""
    torque_limit: float
    """[N·m], the same for all joints"""
    velocity_limit: float
    """[rad/s], the same for all joints"""
    default_pose: Array
    """[rad]; a zero action of the policy"""
    stand_pose: Array
    """[rad]"""
    crouch_pose: Array
    """[rad]; legs folded, base on or just above the ground"""
    kp: float
    """[N·m/rad], while a policy runs"""
    kd: float
    """[N·m·s/rad], while a policy runs"""
    stand_kp: float
    stand_kd: float
    damping_kd: float
    action_scale: float
    """[rad] of joint target per unit of action"""
    action_clip: float
    """Largest absolute action"""
    leg: Leg
    foot_radius: float
    """[m]"""
    mass: float
    """[kg]"""
    policy_hz: int
    control_hz: int
    scene: Path
    """MJCF of the robot with its sensors on a flat floor"""
