"""Many A1s in MuJoCo's CPU batch engine, seen through torch tensors.

Joint arrays are in the robot's joint order, feet in FR, FL, RR, RL; "base frame" is the trunk's.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch, SimulationError
from torch import Tensor

from rmll_robots import Robot
from rmll_robots.ground import lay
from rmll_train.env.terrain import Terrain

_UNSTABLE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
    int(mujoco.mjtWarning.mjWARN_BADCTRL),
]
PHYSICS_STEP = 0.005
"""[s]; the paper's: four to a policy step"""
DELAY_STEPS = 4
"""Longest delay of an action, in physics steps"""
_VARIED = (
    "geom_friction", "body_mass", "body_ipos", "actuator_gainprm", "actuator_biasprm",
    "actuator_delay", "dof_damping", "opt.gravity",
)  # fmt: skip


@dataclass(frozen=True)
class Variation:
    """What differs from one robot to the next; tensors (num, ...)."""

    friction: Tensor
    """of the ground and the feet"""
    added_mass: Tensor
    """[kg] on the trunk"""
    centre_of_mass: Tensor
    """[m] (num, 3) shift of the trunk's"""
    strength: Tensor
    """factor on the servos' gains"""
    joint_damping: Tensor
    """[N·m·s/rad]"""
    delay: Tensor
    """[physics steps], whole, from an action to its effect"""


def training_model(robot: Robot, terrain: Terrain | None = None) -> mujoco.MjModel:
    """The robot's scene, made for speed: position servos in the model, few solver iterations.

    Servo: torque = kp (target - q) - kd qd, bounded by the torque limit. Only feet meet the ground:
    episodes end before anything else would. The joints' dry friction is left out, for it costs a
    quarter of the speed, and :meth:`Simulation.vary` damps them instead; the emulator has both.
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
        actuator.nsample = DELAY_STEPS
    for joint in spec.joints:
        joint.frictionloss = 0
    for geom in spec.geoms:
        if geom.name != "floor":
            geom.contype, geom.conaffinity = 0, int(geom.name in robot.foot_names)
    if terrain is not None:
        lay(spec, terrain.field)
    return spec.compile()


class Simulation:
    """State of ``num`` robots after the last :meth:`step`, as float32 tensors (num, ...)."""

    base_height: Tensor
    """[m] above the ground below"""
    base_velocity: Tensor
    """[m/s] in the base frame"""
    angular_velocity: Tensor
    """[rad/s] in the base frame"""
    projected_gravity: Tensor
    """unit vector in the base frame"""
    joint_position: Tensor
    """[rad]"""
    joint_velocity: Tensor
    """[rad/s]"""
    torque: Tensor
    """[N·m]"""
    foot_force: Tensor
    """[N]"""
    foot_height: Tensor
    """[m] of each foot's underside above the ground below it"""
    knee_height: Tensor
    """[m]"""

    def __init__(self, robot: Robot, num: int, policy_dt: float, terrain: Terrain | None = None):
        self.robot = robot
        self.num = num
        self.substeps = round(policy_dt / PHYSICS_STEP)
        self._terrain = terrain
        self._model = model = training_model(robot, terrain)
        self._batch = Batch(model, num)
        self._trunk = model.body("trunk").id
        bind = self._batch.bind
        self._qpos, self._qvel, self._control = bind("qpos"), bind("qvel"), bind("ctrl")
        self._xpos, self._geom_xpos = bind("xpos"), bind("geom_xpos")
        self._sensor, self._force = bind("sensordata"), bind("actuator_force")
        # of each actuator's delay line (num, joints, ...), the values are the last part
        self._delayed = bind("history").reshape(num, model.nu, -1)[:, :, -DELAY_STEPS:]
        self._varied = {name: self._batch.expand(name) for name in _VARIED}
        feet = robot.foot_names
        self._foot_geom = [model.geom(foot).id for foot in feet]
        self._knee_body = [model.body(f"{foot}_calf").id for foot in feet]
        self._touch = [int(model.sensor(f"{foot}_touch").adr[0]) for foot in feet]
        self.joint_lower = torch.tensor(robot.joint_lower, dtype=torch.float32)
        self.joint_upper = torch.tensor(robot.joint_upper, dtype=torch.float32)
        """(joints,) [rad]"""
        self._down = torch.tensor([[0.0, 0.0, -1.0]])
        self._batch.reset(keyframe=0)
        self._read()

    def step(self, targets: Tensor, gravity: float = 1.0) -> Tensor:
        """Hold joint targets [rad] (num, 12) for one policy step; returns failed robots (num,).

        ``gravity`` is a share of the earth's.

        Targets beyond a joint's limits are brought back to them, as the daemon does (its
        ``Supervisor``): a leg cannot push harder than that where it is almost stretched.
        A failed robot (MuJoCo error, or a state that is not finite) is put back on its feet; its
        episode has to end.
        """
        self._control[:] = targets.clamp(self.joint_lower, self.joint_upper).numpy()
        self._varied["opt.gravity"][:] = gravity * self._model.opt.gravity
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

    def place(self, ids: Tensor, spot: Tensor, joints: Tensor, twist: Tensor) -> None:
        """Put robots upright, no foot in the ground: x, y (n, 2) [m], joints (n, 12) [rad], base
        twist (n, 6)."""
        rows = ids.numpy()
        self._batch.reset(rows, keyframe=0, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        self._qpos[rows, :2] = spot.numpy()
        self._qpos[rows, 7:] = joints.numpy()
        self._qvel[rows, :6] = twist.numpy()
        self._control[rows] = joints.numpy()
        # MuJoCo fills the delay lines with zeros: a target that no robot was given
        self._delayed[rows] = joints.numpy()[:, :, None]
        self._batch.forward(rows, stage=int(mujoco.mjtStage.mjSTAGE_POS))
        self._qpos[rows, 2] -= self._foot_height(rows).amin(1).numpy()
        self._batch.forward(rows)
        for name, values in self._seen(rows).items():  # of the others nothing is new
            getattr(self, name)[ids] = values

    def push(self, ids: Tensor, velocity: Tensor) -> None:
        """Add (n, 2) [m/s] to the base's horizontal velocity."""
        self._qvel[ids.numpy(), :2] += velocity.numpy()

    def vary(self, variation: Variation) -> None:
        """Make the robots differ; all of them, for the rest of the simulation's life."""
        varied, model, trunk = self._varied, self._model, self._trunk
        varied["geom_friction"][:, :, 0] = variation.friction.numpy()[:, None]
        varied["body_mass"][:, trunk] = model.body_mass[trunk] + variation.added_mass.numpy()
        varied["body_ipos"][:, trunk] = model.body_ipos[trunk] + variation.centre_of_mass.numpy()
        strength = variation.strength.numpy()[:, None, None]
        varied["actuator_gainprm"][:] = model.actuator_gainprm * strength
        varied["actuator_biasprm"][:] = model.actuator_biasprm * strength
        varied["dof_damping"][:, 6:] = variation.joint_damping.numpy()[:, None]
        varied["actuator_delay"][:] = variation.delay.numpy()[:, None] * PHYSICS_STEP
        self._batch.set_const()

    def state_dict(self) -> dict[str, Tensor]:
        """Copy of everything that differs between two simulations."""
        live = self._varied | {"state": self._batch.state}
        return {name: torch.from_numpy(array.copy()) for name, array in live.items()}

    def load_state_dict(self, saved: dict[str, Tensor]) -> None:
        for name, array in self._varied.items():
            array[:] = saved[name].numpy()
        self._batch.set_const()
        self._batch.state[:] = saved["state"].numpy()
        self._batch.forward()
        self._read()

    def _height(self, points: Tensor) -> Tensor:
        """Of world points (num, ..., 3) above the ground below them."""
        x, y, z = points.unbind(-1)
        return z if self._terrain is None else z - self._terrain.height(x, y)

    def _read(self) -> None:
        vars(self).update(self._seen(slice(None)))

    def _seen(self, rows: np.ndarray | slice) -> dict[str, Tensor]:
        """The public state of these robots. After a step its last three, MuJoCo's derived fields,
        tell of one physics step (5 ms) earlier, as does the torque."""
        pose, twist = _tensor(self._qpos[rows]), _tensor(self._qvel[rows])
        quaternion = pose[:, 3:7]
        return {
            "base_height": self._height(pose[:, :3]),
            "base_velocity": rotate_inverse(quaternion, twist[:, :3]),
            "angular_velocity": twist[:, 3:6],
            "projected_gravity": rotate_inverse(quaternion, self._down.expand(len(pose), 3)),
            "joint_position": pose[:, 7:],
            "joint_velocity": twist[:, 6:],
            "torque": _tensor(self._force[rows]),
            "foot_force": _columns(self._sensor[rows], self._touch),
            "foot_height": self._foot_height(rows),
            "knee_height": self._height(_columns(self._xpos[rows], self._knee_body)),
        }

    def _foot_height(self, rows: np.ndarray | slice) -> Tensor:
        feet = _columns(self._geom_xpos[rows], self._foot_geom)
        return self._height(feet) - self.robot.foot_radius


def rotate_inverse(quaternion: Tensor, vector: Tensor) -> Tensor:
    """World vectors (n, 3) in the frame whose orientation is ``quaternion`` (n, 4) w, x, y, z."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    twice = 2.0 * torch.linalg.cross(axis, vector)
    return vector - w * twice + torch.linalg.cross(axis, twice)


def _columns(array: np.ndarray, which: list[int]) -> Tensor:
    return _tensor(array.take(which, axis=1))  # half the time of brackets


def _tensor(array: np.ndarray) -> Tensor:
    return torch.from_numpy(array.astype(np.float32))
