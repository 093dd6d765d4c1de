"""Many A1s in MuJoCo's CPU batch engine, seen through torch tensors.

Joint arrays are in the robot's joint order, feet in FR, FL, RR, RL; "base frame" is the trunk's.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch, SimulationError
from torch import Tensor

from rmll_robots import Robot

_UNSTABLE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
    int(mujoco.mjtWarning.mjWARN_BADCTRL),
]
PHYSICS_STEP = 0.005
"""[s]; the paper's: four to a policy step"""


def training_model(robot: Robot) -> mujoco.MjModel:
    """The robot's scene, made for speed: position servos in the model, few solver iterations.

    Servo: torque = kp (target - q) - kd qd, bounded by the torque limit. Joint friction is left out
    (it costs a quarter of the speed); the emulator has it.
    """
    spec = mujoco.MjSpec.from_file(str(robot.scene))
    spec.option.timestep = PHYSICS_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.iterations = 3
    spec.option.ls_iterations = 6
    for actuator in spec.actuators:
        actuator.set_to_position(kp=robot.kp, kv=robot.kd)
        actuator.ctrllimited = False
        actuator.forcelimited = True
        actuator.forcerange = [-robot.torque_limit, robot.torque_limit]
    for joint in spec.joints:
        joint.frictionloss = 0
    for geom in spec.geoms:
        if geom.name != "floor":  # the robot's parts meet the ground, not each other
            geom.contype, geom.conaffinity = 0, 1
    return spec.compile()


class Simulation:
    """State of ``num`` robots after the last :meth:`step`, as float32 tensors (num, ...)."""

    def __init__(self, robot: Robot, num: int, policy_dt: float):
        self.robot = robot
        self.num = num
        self.substeps = round(policy_dt / PHYSICS_STEP)
        model = training_model(robot)
        self._batch = Batch(model, num)
        self._trunk = model.body("trunk").id
        self._trunk_mass = float(model.body_mass[self._trunk])
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._control = self._batch.bind("ctrl")
        self._xpos, self._geom_xpos = self._batch.bind("xpos"), self._batch.bind("geom_xpos")
        self._sensor, self._force = (
            self._batch.bind("sensordata"),
            self._batch.bind("actuator_force"),
        )
        self._friction = self._batch.expand("geom_friction")
        self._mass = self._batch.expand("body_mass")
        feet = robot.foot_names
        self._foot_geom = [model.geom(foot).id for foot in feet]
        self._knee_body = [model.body(f"{foot}_calf").id for foot in feet]
        self._touch = [int(model.sensor(f"{foot}_touch").adr[0]) for foot in feet]
        self._batch.reset(keyframe=0)
        self._read()

    def step(self, targets: Tensor) -> Tensor:
        """Hold joint targets [rad] (num, 12) for one policy step; returns failed robots (num,).

        A failed robot (MuJoCo error, or a state that is not finite) is put back on its feet; its
        episode has to end.
        """
        self._control[:] = targets.numpy()
        failed = np.zeros(self.num, bool)
        try:
            self._batch.step(nstep=self.substeps)
        except SimulationError as error:
            failed[error.ids] = True
        # MuJoCo resets a simulation with values that are not finite, or huge, and warns
        failed |= (self._batch.warning[:, _UNSTABLE, 1] > 0).any(1)
        if failed.any():
            self._batch.reset(failed, keyframe=0)
        self._read()
        return torch.from_numpy(failed)

    def place(self, ids: Tensor, joints: Tensor, twist: Tensor) -> None:
        """Put robots upright on their lowest foot: joints (n, 12) [rad], base twist (n, 6)."""
        rows = ids.numpy()
        self._batch.reset(rows, keyframe=0, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        self._qpos[rows, 7:] = joints.numpy()
        self._qvel[rows, :6] = twist.numpy()
        self._control[rows] = joints.numpy()
        self._batch.forward(rows, stage=int(mujoco.mjtStage.mjSTAGE_POS))
        lowest = self._geom_xpos[rows][:, self._foot_geom, 2].min(1) - self.robot.foot_radius
        self._qpos[rows, 2] -= lowest
        self._batch.forward(rows)
        self._read()

    def push(self, ids: Tensor, velocity: Tensor) -> None:
        """Add (n, 2) [m/s] to the base's horizontal velocity."""
        self._qvel[ids.numpy(), :2] += velocity.numpy()

    def randomise(self, friction: Tensor, added_mass: Tensor) -> None:
        """Per-robot ground friction (num,) and extra trunk mass (num,) [kg]."""
        self._friction[:, :, 0] = friction.numpy()[:, None]
        self._mass[:, self._trunk] = self._trunk_mass + added_mass.numpy()
        self._batch.set_const()

    def state_dict(self) -> dict[str, Tensor]:
        """Copy of everything that differs between two simulations."""
        live = {"state": self._batch.state, "friction": self._friction, "mass": self._mass}
        return {name: torch.from_numpy(array.copy()) for name, array in live.items()}

    def load_state_dict(self, saved: dict[str, Tensor]) -> None:
        self._friction[:], self._mass[:] = saved["friction"].numpy(), saved["mass"].numpy()
        self._batch.set_const()
        self._batch.state[:] = saved["state"].numpy()
        self._batch.forward()
        self._read()

    def _read(self) -> None:
        pose, twist = _tensor(self._qpos), _tensor(self._qvel)
        quaternion = pose[:, 3:7]
        self.base_height = pose[:, 2]
        """[m] above the ground"""
        self.base_velocity = rotate_inverse(quaternion, twist[:, :3])
        """[m/s] in the base frame"""
        self.angular_velocity = twist[:, 3:6]
        """[rad/s] in the base frame"""
        down = torch.tensor([0.0, 0.0, -1.0]).expand(self.num, 3)
        self.projected_gravity = rotate_inverse(quaternion, down)
        """unit vector in the base frame"""
        self.joint_position = pose[:, 7:]
        self.joint_velocity = twist[:, 6:]
        self.torque = _tensor(self._force)
        """[N·m]"""
        # MuJoCo's derived fields describe the state one physics step (5 ms) earlier.
        self.foot_force = _tensor(self._sensor[:, self._touch])
        """[N]"""
        self.foot_height = _tensor(self._geom_xpos[:, self._foot_geom, 2]) - self.robot.foot_radius
        """[m] of the foot's underside above the ground"""
        self.knee_height = _tensor(self._xpos[:, self._knee_body, 2])


def rotate_inverse(quaternion: Tensor, vector: Tensor) -> Tensor:
    """World vectors (n, 3) in the frame whose orientation is ``quaternion`` (n, 4) w, x, y, z."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    twice = 2.0 * torch.linalg.cross(axis, vector)
    return vector - w * twice + torch.linalg.cross(axis, twice)


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(array.astype(np.float32))
