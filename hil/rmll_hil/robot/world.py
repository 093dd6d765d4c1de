"""The world the emulated robot stands in: MuJoCo at 1 kHz, the joint servos as its actuators."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjSpec
from numpy.typing import NDArray

from rmll_robots import Robot
from rmll_robots.ground import HeightField, lay

STEP_MS = 1
"""[ms] of one physics step"""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class World:
    """A robot on its ground. All arrays are live views of MuJoCo's state; joints are (12,).

    The sensors lag the state by one physics step, as MuJoCo evaluates them before it integrates.
    """

    model: MjModel
    data: MjData
    q: Array
    """[rad]"""
    dq: Array
    """[rad/s]"""
    torque: Array
    """[N·m] that the motors applied in the last step, after their limits"""
    quaternion: Array
    """w, x, y, z: base to world"""
    gyro: Array
    """[rad/s], base frame"""
    accelerometer: Array
    """[m/s²], base frame; a robot at rest reads gravity upwards"""
    foot_load: Array
    """[N] normal force on each foot, (4,)"""
    base_contact: Array
    """Contacts between the trunk and the ground, (1,)"""

    @property
    def weight(self) -> float:
        """[N] of the robot"""
        return float(self.model.body_mass.sum() * -self.model.opt.gravity[2])


def load(robot: Robot, friction: float, field: HeightField | None = None) -> World:
    """The robot lying in the middle of ``field``, or on a flat floor; ``friction`` is the sliding
    coefficient of every surface."""
    spec = MjSpec.from_file(str(robot.scene))
    if field is not None:
        lay(spec, field)
    spec.add_sensor(
        name="base_contact",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_GEOM,
        objname="floor",
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname="trunk_collision",
        # what to report (found), how to reduce (unsorted), how many
        intprm=[1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND), 0, 1],
    )
    model = spec.compile()
    model.opt.timestep = STEP_MS * 1e-3
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # feet that stick until they slide: friction as stiff as the normal force, round cones
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.impratio = 10
    model.geom_friction[:, 0] = friction
    # mechanical stops, stiffer than MuJoCo's default, which a lying robot's weight pushes aside
    model.jnt_solref[:, 0] = 0.005
    _servos(model)
    data = MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("lying").id)
    data.qpos[2] += field.middle if field is not None else 0.0
    mujoco.mj_forward(model, data)
    return World(
        model,
        data,
        q=data.qpos[_contiguous([model.joint(name).qposadr[0] for name in robot.joint_names])],
        dq=data.qvel[_contiguous([model.joint(name).dofadr[0] for name in robot.joint_names])],
        torque=data.actuator_force[_contiguous([_actuator(model, n) for n in robot.joint_names])],
        quaternion=data.sensor("imu_quat").data,
        gyro=data.sensor("imu_gyro").data,
        accelerometer=data.sensor("imu_acc").data,
        foot_load=data.sensordata[
            _contiguous([model.sensor(f"{foot}_touch").adr[0] for foot in robot.foot_names])
        ],
        base_contact=data.sensor("base_contact").data,
    )


def push(world: World, velocity: tuple[float, float]) -> None:
    """Change the base's velocity at once, along the world's x and y [m/s]."""
    world.data.qvel[:2] += velocity


def _servos(model: MjModel) -> None:
    """Make every torque motor an affine actuator: force = ctrl - kp q - kd dq, limited.

    The servo law is then part of the model, and its damping is integrated implicitly: it stays
    stable at 1 kHz, as it is on the robot, whose joint boards close the loop at 10 kHz or more.
    """
    model.actuator_gaintype[:] = mujoco.mjtGain.mjGAIN_FIXED
    model.actuator_gainprm[:, 0] = 1
    model.actuator_biastype[:] = mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_ctrllimited[:] = False
    model.actuator_forcelimited[:] = True


def _actuator(model: MjModel, joint: str) -> int:
    (index,) = np.flatnonzero(model.actuator_trnid[:, 0] == model.joint(joint).id)
    return int(index)


def _contiguous(indices: list[int]) -> slice:
    """One slice for the indices, so that indexing with it gives a live view."""
    start, stop = int(indices[0]), int(indices[-1]) + 1
    if [int(index) for index in indices] != list(range(start, stop)):
        raise ValueError(f"the MJCF's order {indices} is not the robot's own order")
    return slice(start, stop)
