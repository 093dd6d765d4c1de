"""The golden trace: the first policy steps of an episode, which the robot must reproduce."""

from dataclasses import replace

import torch
from torch import Tensor

from rmll_common.errors import Failure
from rmll_contract.contract import Trace, float_lists
from rmll_gaits.table import Commands, MachineTable, nearest
from rmll_robots import Robot
from rmll_train.env.environment import GaitEnv
from rmll_train.learning.actor_critic import EstimatingActor
from rmll_train.train_settings import EnvSettings, GroundSettings, ObservationNoise, Randomisation

STEPS = 64
SEED = 7

ALIKE = Randomisation(
    friction=(0.8, 0.8), added_mass=(0.0, 0.0), centre_of_mass=0.0, strength=(1.0, 1.0),
    joint_damping=(0.0, 0.0), delay=(0.0, 0.0), foot_threshold=(1.0, 1.0), push_interval=1e6,
    initial_joint=0.0, initial_velocity=0.0,
)  # fmt: skip
"""Robots that do not differ, start at rest and are not pushed; their sensors are noisy"""
STILL = replace(ALIKE, noise=ObservationNoise(0.0, 0.0, 0.0, 0.0))
"""... and these have no noise"""


@torch.no_grad()
def golden_trace(
    actor: EstimatingActor, table: MachineTable, robot: Robot, world: EnvSettings
) -> Trace:
    """The first steps of an episode: what the robot would sense, and what the trainer answers.

    Raises Failure if the networks answer with what is no number.
    """
    env = GaitEnv(
        table,
        robot,
        replace(
            world,
            envs=1,
            start="first",
            first_clearance=world.clearance,
            first_gravity=1.0,
            ground=GroundSettings(),
            randomisation=STILL,
        ),
        SEED,
    )
    env.fix_commands(torch.tensor(command(table.commands)))
    rows = []
    for _ in range(STEPS):
        obs = env.get_observations()
        senses = _inputs(env)
        action = actor(obs)
        answers = {
            "label": env.contacts.label,
            "state": env.state,
            "phi": env.phi,
            "observation": obs["policy"],
            "estimate": actor.estimate(obs["policy"]),
            "action": action,
        }
        if not (action.isfinite().all() and answers["estimate"].isfinite().all()):
            raise Failure("the networks answer with what is no number: training has diverged")
        # copies: the environment's buffers change in place when an episode ends
        row = {name: value[0].clone() for name, value in (senses | answers).items()}
        env.step(action)
        row["target"] = env.targets[0].clone()
        rows.append(row)
        if env.episode_length_buf[0] == 0:  # it fell: a trace of one episode is enough
            break
    columns = {name: torch.stack([row[name] for row in rows]) for name in rows[0]}
    return Trace(**{name: _plain(column) for name, column in columns.items()})


def command(ranges: Commands) -> list[float]:
    """Half of the highest speed, straight on, the middle frequency: each as near to it as the
    gait's ranges allow, for the robot brings commands back into them."""
    vx, wz = nearest(0.5 * ranges.vx[1], ranges.vx), nearest(0.0, ranges.wz)
    return [vx, wz, ranges.middle_frequency]


def _inputs(env: GaitEnv) -> dict[str, Tensor]:
    simulation = env.simulation
    return {
        "touching": env.contacts.touching,
        "clear": env.contacts.clear,
        "joint_position": simulation.joint_position,
        "joint_velocity": simulation.joint_velocity,
        "projected_gravity": simulation.projected_gravity,
        "angular_velocity": simulation.angular_velocity,
        "command": env.command,
    }


def _plain(column: Tensor) -> list:
    return float_lists(column) if column.is_floating_point() else column.tolist()
