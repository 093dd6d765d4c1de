"""What the robot's daemon would object to, seen in the trainer's world.

The limits are those of the daemon's default settings. It looks 200 times a second and lets some
ticks pass; here robots are seen once a policy step, so this tells of limits that are touched, and
the emulator of those that are not.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from rmll_onboard.safety.guard import WILD
from rmll_onboard.settings.runtime_settings import Safety
from rmll_train.env.environment import GaitEnv


@dataclass(frozen=True)
class _Limit:
    what: str
    """... of a robot that went beyond it, followed by the largest value and the limit"""
    unit: str
    bound: float
    patience: float
    """Policy steps beyond it that pass"""


class SafetyLimits:
    """Which robots of ``env`` went beyond a limit for longer than the daemon would let pass."""

    def __init__(self, env: GaitEnv, safety: Safety | None = None):
        self._env, robot = env, env.robot
        safety = safety or Safety()
        patience = safety.patience * robot.policy_hz / robot.control_hz
        self._limits = {
            "speed": _Limit("a joint turned at", "rad/s", safety.joint_speed, patience),
            "joint": _Limit("a joint was past its limit by", "rad", -safety.joint_margin, patience),
            "power": _Limit("the joints together took", "W", safety.power, patience),
            "action": _Limit("an action was", "times its range", WILD,
                             safety.action_steps),
            "stuck": _Limit("no transition came for", "times c_f", safety.stuck, 0),
        }  # fmt: skip
        self._count = {name: torch.zeros(env.num_envs) for name in self._limits}
        self._touched = {name: torch.zeros(env.num_envs, dtype=torch.bool) for name in self._limits}
        self._worst = dict.fromkeys(self._limits, 0.0)

    def observe(self, actions: Tensor) -> None:
        """After a policy step in which the networks gave these actions (n, 12)."""
        env = self._env
        simulation = env.simulation
        position = simulation.joint_position
        beyond = torch.maximum(simulation.joint_lower - position, position - simulation.joint_upper)
        values = {
            "speed": simulation.joint_velocity.abs().amax(1),
            "joint": beyond.amax(1),
            "power": (simulation.torque * simulation.joint_velocity).abs().sum(1),
            "action": actions.abs().amax(1) / env.robot.action_clip,
            "stuck": env.phi / env.command[:, 2],
        }
        for name, value in values.items():
            limit, over = self._limits[name], ~(value <= self._limits[name].bound)
            # as the daemon counts: a content step takes a complaint back
            count = self._count[name]
            count = self._count[name] = torch.where(over, count + 1, (count - 1).clamp(min=0))
            self._touched[name] |= count > limit.patience
            self._worst[name] = max(self._worst[name], float(value.max()))

    def touched(self) -> list[str]:
        """One sentence a limit that was broken."""
        said = []
        for name, limit in self._limits.items():
            if robots := int(self._touched[name].sum()):
                said.append(
                    f"{limit.what} {self._worst[name]:.3g} {limit.unit}, limit {limit.bound:g}, "
                    f"in {robots} of {self._env.num_envs} walks"
                )
        return said
