"""The learning environment: many A1s under one gait's automaton, as rsl-rl's VecEnv.

One policy step: action -> joint targets held for 20 ms -> contact labels -> automaton -> R_walk,
with the bonus where the automaton advanced -> ends of episodes -> observation.
"""

from typing import TypedDict

import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from torch import Tensor

from rmll_contract import action, observation
from rmll_gaits import machine
from rmll_gaits.schedule import transition_rate
from rmll_gaits.table import MachineTable
from rmll_robots import Robot
from rmll_train.env import reward, terminations, terrain
from rmll_train.env.curriculum import GaitCurriculum, TerrainCurriculum
from rmll_train.env.episode_metrics import EpisodeMetrics
from rmll_train.env.labelling import Contacts
from rmll_train.env.simulation import DELAY_STEPS, PHYSICS_STEP, Simulation, Variation
from rmll_train.train_settings import EnvSettings, ObservationNoise

_BUFFERS = (
    "episode_length_buf", "state", "phi", "command", "_rate", "_last_action",
    "_last_joint_velocity", "_dwell_reward", "_made", "_allowed",
)  # fmt: skip

PRIVILEGED: observation.Layout = (
    *observation.ESTIMATES,
    observation.Field("projected_gravity", 3, 1.0),
    observation.Field("angular_velocity", 3, 0.25),
    observation.Field("base_height", 1, 1.0),
    observation.Field("foot_down", 4, 1.0),
)
"""What the critic sees besides the policy's observation"""


class EnvironmentState(TypedDict):
    """Everything that changes while it is trained in."""

    buffers: dict[str, Tensor]
    simulation: dict[str, Tensor]
    observed: dict[str, Tensor]
    random: Tensor
    """Of the generator"""
    level: Tensor
    """Of the ground, (envs,)"""
    demands: dict[str, float]
    failures: int


class GaitEnv(VecEnv):
    """Observation groups: ``policy`` (noisy, what the robot can measure), ``critic`` (true state)
    and ``estimate`` (the estimator's targets: base velocity (3) [m/s], foot heights (4) [m]).
    """

    num_actions = observation.JOINTS
    device = "cpu"

    def __init__(self, table: MachineTable, robot: Robot, world: EnvSettings, seed: int):
        self.table, self.robot, self.world = table, robot, world
        self.cfg = world
        self.num_envs = world.envs
        self.dt = 1.0 / robot.policy_hz
        self.max_episode_length = round(world.episode * robot.policy_hz)
        self.layout = observation.layout(world.profile, table.num_states)
        self.groups = {
            "policy": self.layout,
            "critic": self.layout + PRIVILEGED,
            "estimate": observation.ESTIMATES,
        }
        """Fields of each observation group; those of ``estimate`` are not scaled"""
        self.generator = torch.Generator().manual_seed(seed)
        ground = terrain.build(world.ground, seed) if world.ground.kinds else None
        self.simulation = Simulation(robot, self.num_envs, self.dt, ground)
        self.levels = TerrainCurriculum(ground, world.ground, self.num_envs, self.generator)
        self.demands = GaitCurriculum(world)
        self.machine = machine.Machine.of(table, lambda array: torch.from_numpy(array.copy()))
        self._default = torch.tensor(robot.default_pose, dtype=torch.float32)
        self._one_hot = torch.eye(table.num_states)
        self._noise = _half_widths(self.layout, world.randomisation.noise)
        self._fine = reward.FineWidths.of(table.commands, world.rewards)
        self._metrics = EpisodeMetrics.zeros(self.num_envs)
        self._fixed: Tensor | None = None
        self.failures = 0
        """Robots put back so far because their physics or reward was not finite"""

        n = self.num_envs
        self.episode_length_buf = torch.zeros(n, dtype=torch.long)
        self.state = torch.zeros(n, dtype=torch.long)
        self.phi = torch.zeros(n, dtype=torch.long)
        self.contacts = Contacts(n, world, self.dt)
        self.command = torch.zeros(n, 3)
        self._rate = torch.zeros(n)  # transitions a step that the command allows
        self._last_action = torch.zeros(n, self.num_actions)
        self._last_joint_velocity = torch.zeros(n, self.num_actions)
        self._dwell_reward = torch.zeros(n)
        self._made, self._allowed = torch.zeros(n), torch.zeros(n)  # transitions, this episode
        self._vary_robots()
        self.begin_anew()

    # -- rsl-rl's interface -------------------------------------------------------------------

    def get_observations(self) -> TensorDict:
        return self._observed

    def _observe(self) -> TensorDict:
        """Observation groups of this moment, with newly drawn noise."""
        measured, fields = self._measured(), self.groups["critic"]
        true = torch.empty(self.num_envs, observation.size(fields))
        observation.write(true, fields, measured)
        own = true[:, : len(self._noise)]  # the policy's fields are the critic's first
        groups = {
            "policy": own + self._uniform(own.shape, -1, 1) * self._noise,
            "critic": true,
            "estimate": torch.cat([measured["velocity"], measured["foot_height"]], dim=1),
        }
        return TensorDict(groups, batch_size=[self.num_envs])

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Tensor]]:
        clip, scale = self.robot.action_clip, self.robot.action_scale
        taken = actions.detach().nan_to_num().clamp(-clip, clip)
        self.targets = action.targets(taken, self._default, scale, clip)
        failed = self.simulation.step(self.targets, self.demands.gravity)

        landed_after = self.contacts.observe(self.simulation, self.demands.clearance)
        step, wrong = self._step_machine()
        explained = machine.explained(self.machine, self.state, self.contacts.label)
        down, beyond = (
            terminations.down(self.simulation, self.world.terminations),
            self._beyond(taken),
        )
        if self._ends_at_mistakes:
            unpaid, ended = wrong, down | beyond
        else:
            unpaid, ended = wrong | beyond, down
        rewards, walk = self._reward(taken, landed_after, step, unpaid)
        undefined = ~rewards.isfinite()
        self.failures += int((failed | undefined).sum())
        failed = failed | undefined
        ended = ended | step.rejected | failed
        rewards = torch.where(failed, torch.zeros(()), rewards)
        self.state, self.phi = step.state, step.phi
        self._last_action = taken
        self._last_joint_velocity = self.simulation.joint_velocity.clone()
        self.episode_length_buf = self.episode_length_buf + 1

        timeout = (self.episode_length_buf >= self.max_episode_length) & ~ended
        done = ended | timeout
        self._count(step, explained, walk, done, ended, down)
        self._disturb()
        if done.any():
            over = done.nonzero()[:, 0]
            adherence = self._made[over] / self._allowed[over]
            self.levels.update(over, timeout[over], down[over], adherence)
            self._begin(over)
        self._observed = self._observe()
        return self._observed, rewards, done, {"time_outs": timeout}

    # -- what the trainer reads ---------------------------------------------------------------

    def take_metrics(self) -> EpisodeMetrics:
        """Sums since the last call."""
        sums, self._metrics = self._metrics, EpisodeMetrics.zeros(self.num_envs)
        return sums

    def begin_anew(self) -> None:
        """All robots begin a new episode."""
        self._begin(torch.arange(self.num_envs))
        self._observed = self._observe()

    def fix_commands(self, commands: Tensor) -> None:
        """From now on each robot keeps its row of ``commands``, (n, 3), or all keep (3,)."""
        self._fixed = commands.expand(self.num_envs, 3)
        self._draw_commands(torch.arange(self.num_envs))
        self._observed = self._observe()

    def state_dict(self) -> EnvironmentState:
        """Everything that :meth:`load_state_dict` needs to go on from here."""
        return {
            "buffers": {name: buffer.clone() for name, buffer in self._buffers().items()},
            "simulation": self.simulation.state_dict(),
            "observed": self._observed.to_dict(),
            "random": self.generator.get_state(),
            "level": self.levels.level.clone(),
            "demands": self.demands.state_dict(),
            "failures": self.failures,
        }

    def load_state_dict(self, saved: EnvironmentState) -> None:
        for name, buffer in self._buffers().items():
            buffer[:] = saved["buffers"][name]
        self.simulation.load_state_dict(saved["simulation"])
        self._observed = TensorDict(saved["observed"], batch_size=[self.num_envs])
        self.generator.set_state(saved["random"])
        self.levels.level[:] = saved["level"]
        self.demands.load_state_dict(saved["demands"])
        self.failures = saved["failures"]

    def _buffers(self) -> dict[str, Tensor]:
        owners = ((self, _BUFFERS), (self.contacts, Contacts.BUFFERS))
        return {name: getattr(owner, name) for owner, names in owners for name in names}

    # -- one policy step, in parts ------------------------------------------------------------

    @property
    def _ends_at_mistakes(self) -> bool:
        return self.demands.strict and self.world.on_violation == "end"

    def _step_machine(self) -> tuple[machine.Step, Tensor]:
        """The automaton's step, and the robots whose contacts a reject edge forbids (n,).

        These wait in their state instead of falling into the sink, unless mistakes end the episode.
        """
        step = machine.step(
            self.machine, self.state, self.phi, self.contacts.label, self.command[:, 2],
            self.episode_length_buf,
        )  # fmt: skip
        wrong = step.rejected
        if self._ends_at_mistakes:
            return step, wrong
        state = torch.where(wrong, self.state, step.state)
        phi = torch.where(wrong, self.phi + 1, step.phi)
        return machine.Step(state, phi, step.advanced, torch.zeros_like(wrong)), wrong

    def _reward(
        self, taken: Tensor, landed_after: Tensor, step: machine.Step, unpaid: Tensor
    ) -> tuple[Tensor, Tensor]:
        """What each robot earns with this step, and its R_walk, 0 where ``unpaid``; each (n,)."""
        settings = self.world.rewards
        motion = reward.BaseMotion(
            self.command, taken, self._last_action, self._last_joint_velocity, landed_after
        )
        cost_scale = self.demands.cost_scale
        terms = reward.terms(self.simulation, motion, settings, self._fine, cost_scale, self.dt)
        walk = reward.walking(terms, settings, cost_scale, self.dt)
        walk = walk * ~unpaid
        self._dwell_reward = self._dwell_reward + walk
        waited = self.phi + 1
        praised = walk if settings.bonus_source == "step" else self._dwell_reward / waited
        dwell = self.machine.dwell[self.state, self.contacts.label]
        promptness = reward.promptness(dwell, self.command[:, 2], waited)
        praised = praised * promptness**settings.promptness
        self._dwell_reward = self._dwell_reward * ~step.advanced
        return torch.where(step.advanced, praised * settings.bonus, walk), walk

    def _beyond(self, taken: Tensor) -> Tensor:
        """Robots (n,) that break a limit which holds once the demands are strict."""
        if not self.demands.strict:
            return torch.zeros(self.num_envs, dtype=torch.bool)
        return terminations.beyond_limits(
            self.simulation, self.world.terminations, taken - self._last_action
        )

    def _disturb(self) -> None:
        """Pushes, and new commands within an episode."""
        r = self.world.randomisation
        pushed = (self._uniform((self.num_envs,), 0, r.push_interval) < self.dt).nonzero()[:, 0]
        if len(pushed):
            self.simulation.push(pushed, self._uniform((len(pushed), 2), -1, 1) * r.push_velocity)
        age, period = self.episode_length_buf, max(1, round(self.world.command_interval / self.dt))
        over = (age % period == 0) & (age > 0) & (age < self.max_episode_length)
        if over.any():
            self._draw_commands(over.nonzero()[:, 0])

    def _vary_robots(self) -> None:
        """Each robot keeps its friction and mass for the whole run, as in legged_gym."""
        r, n = self.world.randomisation, (self.num_envs,)
        delay = (self._uniform(n, *r.delay) / PHYSICS_STEP).round().clamp(0, DELAY_STEPS)
        variation = Variation(
            friction=self._uniform(n, *r.friction),
            added_mass=self._uniform(n, *r.added_mass),
            centre_of_mass=self._uniform((*n, 3), -1, 1) * r.centre_of_mass,
            strength=self._uniform(n, *r.strength),
            joint_damping=self._uniform(n, *r.joint_damping),
            delay=delay,
        )
        self.simulation.vary(variation)
        self.contacts.threshold *= self._uniform((self.num_envs, 4), *r.foot_threshold)

    def _begin(self, ids: Tensor) -> None:
        """Start new episodes for these robots."""
        r, count = self.world.randomisation, len(ids)
        joints = self._default + self._uniform((count, 12), -1, 1) * r.initial_joint
        twist = self._uniform((count, 6), -1, 1) * r.initial_velocity
        self.simulation.place(ids, self.levels.spots(ids), joints, twist)
        self._draw_commands(ids)
        self.episode_length_buf[ids] = 0
        self.state[ids] = self._first_states(count)
        self.phi[ids] = 0
        self.contacts.begin(ids)
        for memory in (
            self._last_action, self._last_joint_velocity, self._dwell_reward, self._made,
            self._allowed,
        ):  # fmt: skip
            memory[ids] = 0.0

    def _first_states(self, count: int) -> Tensor:
        if self.world.start == "first" or self.demands.strict:
            return torch.full((count,), self.table.start)
        states = [s for s in range(self.table.num_states) if s != self.table.sink]
        return torch.tensor(states)[torch.randint(len(states), (count,), generator=self.generator)]

    def _draw_commands(self, ids: Tensor) -> None:
        if self._fixed is not None:
            self.command[ids] = self._fixed[ids]
        else:
            ranges, count = self.table.commands, (len(ids),)
            self.command[ids, 0] = self._uniform(count, *ranges.vx)
            self.command[ids, 1] = self._uniform(count, *ranges.wz)
            self.command[ids, 2] = self._frequencies(count)
        self._rate[ids] = transition_rate(self.table, self.command[ids, 2])

    def _frequencies(self, shape: tuple[int, ...]) -> Tensor:
        """c_f [policy steps], whole ones where the gait's range has some."""
        commands = self.table.commands
        whole = commands.whole_frequencies
        if not whole:
            return self._uniform(shape, *commands.frequency)
        return torch.randint(whole.start, whole.stop, shape, generator=self.generator).float()

    # -- observations -------------------------------------------------------------------------

    def _measured(self) -> dict[str, Tensor]:
        simulation = self.simulation
        return {
            "rm_state": self._one_hot[self.state],
            "phi": self.phi[:, None].float(),
            "joint_position": simulation.joint_position - self._default,
            "joint_velocity": simulation.joint_velocity,
            "last_action": self._last_action,
            "command_vx": self.command[:, 0:1],
            "command_wz": self.command[:, 1:2],
            "command_frequency": self.command[:, 2:3],
            "projected_gravity": simulation.projected_gravity,
            "angular_velocity": simulation.angular_velocity,
            "velocity": simulation.base_velocity,
            "foot_height": simulation.foot_height,
            "base_height": simulation.base_height[:, None],
            "foot_down": self.contacts.down.float(),
        }

    # -- bookkeeping --------------------------------------------------------------------------

    def _count(
        self, step: machine.Step, explained: Tensor, walk: Tensor, done: Tensor, ended: Tensor,
        down: Tensor,
    ) -> None:  # fmt: skip
        simulation, sums = self.simulation, self._metrics
        self._made = self._made + step.advanced
        self._allowed = self._allowed + self._rate
        power = (simulation.torque * simulation.joint_velocity).abs().sum(1)
        sums.steps += 1
        sums.transitions += step.advanced
        sums.allowed += self._rate
        sums.off_spec += ~explained
        sums.vx_error += (self.command[:, 0] - simulation.base_velocity[:, 0]).abs()
        sums.wz_error += (self.command[:, 1] - simulation.angular_velocity[:, 2]).abs()
        sums.energy += power * self.dt
        sums.distance += simulation.base_velocity[:, :2].norm(dim=1) * self.dt
        sums.walk_reward += walk
        sums.level += self.levels.level
        sums.episodes += done
        sums.ends += ended
        sums.falls += down
        sums.length += self.episode_length_buf * done

    def _uniform(self, shape: tuple[int, ...], low: float, high: float) -> Tensor:
        return torch.rand(shape, generator=self.generator) * (high - low) + low


def _half_widths(fields: observation.Layout, noise: ObservationNoise) -> Tensor:
    """Of the noise on each number of an observation with these fields, scaled as it is."""
    widths = [
        torch.full((field.size,), field.scale * getattr(noise, field.name, 0.0)) for field in fields
    ]
    return torch.cat(widths)
