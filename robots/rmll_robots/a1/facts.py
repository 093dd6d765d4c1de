"""Constants of the Unitree A1, each with its public source.

Legs in the robot's own order FR, FL, RR, RL (unitree_legged_sdk, quadruped.h); within a leg
hip (abduction), thigh, calf.
"""

from pathlib import Path

import numpy as np

from rmll_robots.robot import Array, Leg, Robot

LEGS = ("FR", "FL", "RR", "RL")
JOINT_NAMES = tuple(f"{leg}_{joint}_joint" for leg in LEGS for joint in ("hip", "thigh", "calf"))


def _per_joint(hip: float, thigh: float, calf: float) -> Array:
    array = np.tile([hip, thigh, calf], len(LEGS)).astype(np.float64)
    array.flags.writeable = False
    return array


def _pose(hip_left: float, thigh_front: float, thigh_rear: float, calf: float) -> Array:
    """Mirror-symmetric pose: the right hips carry the opposite sign of the left ones."""
    pose = [
        value
        for leg in LEGS
        for value in (
            hip_left if leg.endswith("L") else -hip_left,
            thigh_front if leg.startswith("F") else thigh_rear,
            calf,
        )
    ]
    array = np.array(pose)
    array.flags.writeable = False
    return array


A1 = Robot(
    name="a1",
    joint_names=JOINT_NAMES,
    foot_names=LEGS,
    # unitree_ros a1_description/xacro/const.xacro; a1_const.h of the SDK rounds the same values
    joint_lower=_per_joint(-0.802851, -1.0472, -2.69653),
    joint_upper=_per_joint(0.802851, 4.18879, -0.916298),
    # const.xacro and robot_lab's DCMotorCfg; other A1 URDFs carry wrong efforts and speeds
    torque_limit=33.5,
    velocity_limit=21.0,
    # legged_gym's a1_config, as the paper's code uses it
    default_pose=_pose(0.1, 0.8, 1.0, -1.5),
    # rl_sar's A1 stance and the crouch from which rl_sar and unitree_rl_lab rise
    stand_pose=_pose(0.0, 0.8, 0.8, -1.5),
    crouch_pose=_pose(0.0, 1.36, 1.36, -2.65),
    # the paper: Kp 20, Kd 0.5
    kp=20.0,
    kd=0.5,
    # rl_sar's fixed stand
    stand_kp=80.0,
    stand_kd=3.0,
    # rl_sar's passive mode uses 8, unitree_guide's 3
    damping_kd=5.0,
    action_scale=0.25,
    # 2 rad away from the default pose: beyond it the motors are at their torque limit anyway
    action_clip=8.0,
    # the older URDF's lengths; inertias: of a1.xml's mass matrix, armature included
    leg=Leg(
        hip_offset=0.08505,
        thigh=0.2,
        calf=0.2,
        hip_inertia=0.0345,
        thigh_inertia=0.0319,
        calf_inertia=0.0173,
        calf_on_thigh=0.0071,
        bend_inertia=0.006,
    ),
    foot_radius=0.02,
    # sum of the older URDF's links, as in MuJoCo Menagerie's unitree_a1
    mass=12.453,
    policy_hz=50,
    control_hz=200,
    scene=Path(__file__).with_name("scene.xml"),
)
