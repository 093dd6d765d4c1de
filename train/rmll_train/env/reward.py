"""R_walk of the paper, and how a transition multiplies it."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from rmll_gaits.schedule import least_steps
from rmll_gaits.table import Commands
from rmll_train.env.simulation import Simulation
from rmll_train.train_settings import Rewards

AIR_TIME_TARGET = 0.5
"""[s], legged_gym"""
SPEED_OFFSET = 0.5
"""[m/s] added to the speed by which power is divided: stepping on the spot costs too"""
SOFT_LIMIT = 0.9
"""Share of the joint range that costs nothing (legged_gym's soft_dof_pos_limit)"""
LEAST_PROMPTNESS = 0.25
LEAST_SPEED = 0.25
"""[m/s], [rad/s] that the largest command counts as at least, for the narrow kernels"""


@dataclass(frozen=True)
class BaseMotion:
    """What R_walk needs besides the simulation's state; tensors (n, ...)."""

    command: Tensor
    """vx [m/s], wz [rad/s], ..."""
    action: Tensor
    last_action: Tensor
    last_joint_velocity: Tensor
    landed_after: Tensor
    """(n, 4) [s] a foot was in the air before it touched down in this step; 0 if it did not"""


class FineWidths(NamedTuple):
    """Of the narrow kernels, for a gait's ranges of commands."""

    vx: float
    wz: float

    @classmethod
    def of(cls, commands: Commands, settings: Rewards) -> "FineWidths":
        """Without ``fine_share`` both are those of the wide kernel."""
        if not settings.fine_share:
            return cls(settings.width, settings.width)
        largest = (max(map(abs, limits)) for limits in (commands.vx, commands.wz))
        return cls(*((settings.fine_share * max(one, LEAST_SPEED)) ** 2 for one in largest))


def terms(
    simulation: Simulation,
    motion: BaseMotion,
    settings: Rewards,
    fine: FineWidths,
    cost_scale: float,
    dt: float,
) -> dict[str, Tensor]:
    """Weighted terms of R_walk per second, each (n,); the first two are the tracking rewards."""
    wide, narrowed = settings.width, max(1.0, cost_scale) ** 3
    velocity, spin = simulation.base_velocity, simulation.angular_velocity
    joint_velocity, torque = simulation.joint_velocity, simulation.torque
    acceleration = (motion.last_joint_velocity - joint_velocity) / dt
    landed = motion.landed_after
    wanted = motion.command[:, 0]
    # power is divided by the speed reached, not the one wanted: going slower saves little
    progress = (velocity[:, 0] * wanted.sign()).clamp(min=0).minimum(wanted.abs())
    moving = (motion.command[:, :2].norm(dim=1) > 0.1).float()
    air_time = ((landed - AIR_TIME_TARGET) * (landed > 0)).sum(1) * moving
    raw = {
        "velocity_x": _track(wanted - velocity[:, 0], wide, fine.vx, narrowed),
        "velocity_yaw": _track(motion.command[:, 1] - spin[:, 2], wide, fine.wz, narrowed),
        "velocity_z": velocity[:, 2].square(),
        "velocity_y": velocity[:, 1].square(),
        "angular_velocity_xy": spin[:, :2].square().sum(1),
        "torque": torque.square().sum(1),
        "joint_acceleration": acceleration.square().sum(1),
        "air_time": air_time,
        "action_rate": (motion.last_action - motion.action).square().sum(1),
        "joint_limit": _beyond_limits(simulation),
        "foot_lift": (simulation.foot_height - settings.free_lift).clamp(min=0).sum(1),
        "power": (torque * joint_velocity).abs().sum(1) / (progress + SPEED_OFFSET),
    }
    return {name: value * getattr(settings, name) for name, value in raw.items()}


def walking(weighted: dict[str, Tensor], settings: Rewards, cost_scale: float, dt: float) -> Tensor:
    """R_walk (n,) >= 0 of one policy step, from :func:`terms`; ``cost_scale`` scales the costs."""
    values = list(weighted.values())
    tracking = values[0] + values[1]
    rest = torch.stack(values[2:]).sum(0) * cost_scale
    if settings.reward_shaping == "clip":
        return (tracking + rest).clamp(min=0) * dt
    return tracking * rest.clamp(max=0).exp() * dt


def promptness(dwell: Tensor, frequency: Tensor, waited: Tensor) -> Tensor:
    """(n,) 1 for a transition in the first policy step that its dwell allows, less for a later one.

    At least ``LEAST_PROMPTNESS``, so that the first ones, which come by chance, are worth finding.
    """
    due = least_steps(dwell, frequency).float()  # a gait's table is of double precision
    return (due / waited).clamp(LEAST_PROMPTNESS, 1.0)


def _track(error: Tensor, wide: float, fine: float, narrowed: float) -> Tensor:
    """The mean of a wide kernel, which leads from afar, and a narrow one, for exactness."""
    square = error.square() * narrowed
    return ((-square / wide).exp() + (-square / fine).exp()) / 2


def _beyond_limits(simulation: Simulation) -> Tensor:
    position, lower, upper = (
        simulation.joint_position, simulation.joint_lower, simulation.joint_upper
    )  # fmt: skip
    margin = (upper - lower) * (1 - SOFT_LIMIT) / 2
    return (position - position.clamp(lower + margin, upper - margin)).abs().sum(1)
