"""When a robot is down, and when it is beyond a limit."""

from torch import Tensor

from rmll_train.env.simulation import Simulation
from rmll_train.train_settings import Terminations

TIPPED = -0.5
"""z of the gravity vector in the base frame beyond which a robot (60 degrees) goes to the ground"""


def down(simulation: Simulation, limit: Terminations) -> Tensor:
    """Robots (n,) that are on the ground with more than their feet, or about to be."""
    return (
        (simulation.base_height < limit.base_down)
        | (simulation.knee_height.amin(1) < limit.knee_height)
        | (simulation.projected_gravity[:, 2] > TIPPED)
    )


def beyond_limits(simulation: Simulation, limit: Terminations, action_change: Tensor) -> Tensor:
    """Robots (n,) whose posture, joints or change of action (n, 12) break a limit."""
    position, margin = simulation.joint_position, limit.joint_margin
    fastest = limit.joint_speed * simulation.robot.velocity_limit
    lower, upper = simulation.joint_lower - margin, simulation.joint_upper + margin
    return (
        (simulation.base_height < limit.base_height)
        | (simulation.foot_height.amax(1) > limit.foot_height)
        | ((position < lower) | (position > upper)).any(1)
        | (simulation.joint_velocity.abs().amax(1) > fastest)
        | (action_change.abs().sum(1) > limit.action_rate)
    )
