"""Every number of a training run, in one tree of frozen dataclasses, kept as YAML beside the run.

A docstring says unit, range and meaning. What a setting was seen to do is in docs/notebook.

The defaults are what ``rmll-train`` uses; ``paper()`` gives the values of the paper and of its
authors' code, with our departures turned off.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Literal, TypedDict

import msgspec

from rmll_common import typed_yaml
from rmll_common.errors import InputError
from rmll_contract.observation import Profile
from rmll_robots import ground

MOST_ENVS, MOST_SAMPLES = 2**16, 2**24
"""Robots, and steps of all of them in a rollout: no memory has room for what a slip asks for"""


@dataclass(frozen=True)
class Rewards:
    """R_walk and the bonus. Weights, per second: rewards above 0, costs below 0, 0 = off."""

    RENAMED: ClassVar[dict[str, str]] = {
        "pressure": "cost_scale",
        "strict_above": "strict_above_adherence",
        "form": "reward_shaping",
        "bonus_on": "bonus_source",
    }
    velocity_x: float = 1.0
    """Weight of exp(-(c_x - v_x)^2 / width), the forward speed's tracking"""
    velocity_yaw: float = 0.7
    """Weight of exp(-(c_w - w_z)^2 / width), the turning speed's tracking; the paper has 0.5"""
    width: float = 0.25
    """[m2/s2], [rad2/s2], above 0: of both tracking rewards"""
    fine_share: float = 0.2
    """Share, 0 to 1, of the largest command. Half of each tracking reward is a narrower kernel,
    exp(-(error / (share x largest command))^2). 0 = off, as in the paper"""
    velocity_z: float = -2.0
    """Weight of v_z^2 [m2/s2]"""
    angular_velocity_xy: float = -0.05
    """Weight of w_x^2 + w_y^2 [rad2/s2]"""
    torque: float = -0.0002
    """Weight of the joints' sum of torque^2 [N2·m2]"""
    joint_acceleration: float = -2.5e-7
    """Weight of the joints' sum of acceleration^2 [rad2/s4]"""
    air_time: float = 1.0
    """Weight of the sum of (time in the air - 0.5 s) at touch-down"""
    action_rate: float = -0.01
    """Weight of the sum of (change of action)^2"""
    cost_scale: tuple[float, float] = (0.2, 1.5)
    """Least and largest factor on all costs, at least 0. The factor grows while robots hold the
    gait and their speed, and shrinks while they do not. Above 1 its cube narrows ``width`` too.
    Equal ends: a fixed factor, 1 in the paper"""
    hold_adherence: float = 0.8
    """Adherence, 0 to 1, with exploration and pushes: above it the factor grows ..."""
    hold_vx_error: float = 0.2
    """... if the mean error [m/s] of the forward speed is below this"""
    strict_above_adherence: float = 0.85
    """Adherence, 0 to 1, from which on, for good, the limits of ``Terminations`` hold and
    ``EnvSettings.on_violation`` says what reject edges do. Until then forbidden contacts only earn
    nothing, and an episode ends when the robot is down. 0 = strict from the beginning, the paper"""
    joint_limit: float = -10.0
    """Weight of the sum of [rad] beyond 90 % of the joints' ranges; of the authors' code alone"""
    power: float = -0.01
    """Weight of sum |torque x joint velocity| / (v + 0.5 m/s) [N], about the energy per metre; v is
    the speed in the wanted direction, at most |c_x|. Ours"""
    velocity_y: float = -1.0
    """Weight of v_y^2 [m2/s2]; ours"""
    foot_lift: float = 0.0
    """Weight of the sum over feet of their height above ``free_lift`` [m]; ours"""
    free_lift: float = 0.05
    """[m] above the ground, at least 0, to which lifting a foot costs nothing"""
    reward_shaping: Literal["exp", "clip"] = "exp"
    """How costs lower the tracking reward. "clip" = max(0, sum of all terms): the paper's code.
    "exp" = tracking x exp(costs), which stays positive, so that the very first transitions of an
    untrained policy already pay their bonus (Ji et al. 2022)."""
    bonus: float = 1000.0
    """b, at least 0: a transition multiplies the reward of its step"""
    bonus_source: Literal["dwell", "step"] = "dwell"
    """What a transition's bonus multiplies: R_walk of its step (the paper), or the mean of R_walk
    since the last transition, so that the motion between the poses counts as well"""
    promptness: float = 2.0
    """At least 0: a late transition's bonus is multiplied by (dwell / steps waited) to this power.
    0 = off"""


@dataclass(frozen=True)
class ObservationNoise:
    """Half-widths of the uniform noise on observations (legged_gym)."""

    joint_position: float = 0.01
    """[rad]"""
    joint_velocity: float = 1.5
    """[rad/s]"""
    projected_gravity: float = 0.05
    """[1], of a unit vector"""
    angular_velocity: float = 0.2
    """[rad/s]"""


@dataclass(frozen=True)
class Randomisation:
    """What differs between simulated robots, and what disturbs them; least and largest of each."""

    friction: tuple[float, float] = (0.5, 1.25)
    """Coefficient of sliding friction between foot and ground, above 0"""
    added_mass: tuple[float, float] = (-1.0, 2.0)
    """[kg] added to the trunk: a real A1 carries a battery and a computer"""
    centre_of_mass: float = 0.03
    """[m], at least 0: the trunk's is moved by up to this along each axis"""
    strength: tuple[float, float] = (0.9, 1.1)
    """Factor on the servos' gains, above 0"""
    joint_damping: tuple[float, float] = (0.0, 0.15)
    """[N·m·s/rad], at least 0: in place of the joints' dry friction"""
    delay: tuple[float, float] = (0.0, 0.02)
    """[s], at least 0, from an action to its effect at the joints, rounded to physics steps"""
    foot_threshold: tuple[float, float] = (1.0, 8.0)
    """Factor on ``EnvSettings.contact_force`` for each foot, above 0: foot sensors miss a light
    touch"""
    push_interval: float = 15.0
    """[s], above 0: mean time between two pushes. Each robot is pushed at moments of its own, so
    that no gait's rhythm meets all pushes with the same feet on the ground"""
    push_velocity: float = 1.0
    """[m/s], at least 0: largest change of the base's velocity along x and along y"""
    initial_joint: float = 0.1
    """[rad], at least 0: an episode begins this far around the default pose at most"""
    initial_velocity: float = 0.3
    """[m/s], [rad/s], at least 0: largest speed of the base at the beginning"""
    noise: ObservationNoise = field(default_factory=ObservationNoise)


@dataclass(frozen=True)
class GroundSettings(ground.Ground):
    """What robots stand on, and when they are sent to harder ground."""

    harder_above: float = 0.8
    """Adherence, 0 to 1, of a whole episode from which on the robot's next tile is a level harder;
    that of a robot that fell is a level easier"""


@dataclass(frozen=True)
class Terminations:
    """Limits that end an episode before its time, or as ``EnvSettings.on_violation`` says."""

    base_height: float = 0.25
    """[m] above the ground: least height of the base"""
    base_down: float = 0.15
    """[m] above the ground: with its base below this, or its knees below ``knee_height``, a robot
    is down, which always ends the episode"""
    knee_height: float = 0.03
    """[m] above the ground, see ``base_down``"""
    joint_margin: float = 0.05
    """[rad] that a joint may be past its limit"""
    action_rate: float = 40.0
    """Largest sum of |change of action| in a policy step"""
    foot_height: float = 0.25
    """[m] above the ground: largest height of a foot"""
    joint_speed: float = 1.0
    """Largest share of the joint speed at which the robot's daemon stops it"""


@dataclass(frozen=True)
class EnvSettings:
    """The learning environment."""

    RENAMED: ClassVar[dict[str, str]] = {"mistakes": "on_violation"}
    profile: Profile = "imu"
    """What the policy sees, see :mod:`rmll_contract.observation`"""
    envs: int = 1024
    """Simulated robots, 1 to 65536"""
    episode: float = 20.0
    """[s], above 0"""
    command_interval: float = 10.0
    """[s], above 0, between two draws of the commands within an episode"""
    start: Literal["any", "first"] = "any"
    """State of the automaton in which an episode begins until the demands are strict: any, so that
    every pose of the gait is tried from the first episodes on, or the first, as on the robot"""
    contact_force: float = 1.0
    """[N], above 0: from this load on a foot counts as in contact"""
    clearance: float = 0.03
    """[m] above the ground, from which on a foot counts as in the air ..."""
    first_clearance: float = 0.01
    """... and that at the beginning, at most ``clearance``. It grows with the adherence until the
    demands are strict"""
    first_gravity: float = 0.3
    """Share, 0 to 1, of the earth's gravity at the beginning. It grows in the same way"""
    on_violation: Literal["end", "unpaid"] = "unpaid"
    """What a broken limit of ``Terminations`` or a reject edge does while the robot is not down: it
    ends the episode (the paper), or its steps earn nothing and the automaton waits, as it does on
    the robot"""
    ground: GroundSettings = field(default_factory=GroundSettings)
    rewards: Rewards = field(default_factory=Rewards)
    randomisation: Randomisation = field(default_factory=Randomisation)
    terminations: Terminations = field(default_factory=Terminations)


@dataclass(frozen=True)
class LearnerSettings:
    """PPO and the estimator."""

    steps: int = 12_000_000
    """Environment steps of the whole run, at least 1: of all robots together"""
    rollout: int = 12
    """Policy steps of each robot between two updates, at least 1"""
    epochs: int = 2
    """Passes of the actor over a rollout, at least 1"""
    critic_epochs: int = 1
    """Passes of the critic, 1 to ``epochs``. In the actor's other epochs its batches are shared out
    between both threads"""
    mini_batches: int = 4
    """Parts into which a rollout is split in each epoch, at least 1"""
    hidden: tuple[int, ...] = (256, 256, 256)
    """Units of each hidden layer of actor and critic"""
    learning_rate: float = 1e-3
    """At the beginning, within ``rate_range``"""
    rate_range: tuple[float, float] = (1e-4, 4e-3)
    """Bounds within which the learning rate follows ``desired_kl``"""
    spread_rate: float = 5.0
    """Factor on the learning rate of the action distribution's spread, above 0"""
    desired_kl: float = 0.01
    """[nat], above 0: divergence between the policies before and after an update"""
    clip: float = 0.2
    """Of PPO's probability ratio: it counts from 1 - clip to 1 + clip"""
    clip_value: bool = False
    """Clip the value loss as well, by ``clip``"""
    gamma: float = 0.99
    """Discount of a policy step, 0 to 1"""
    lam: float = 0.95
    """Lambda of generalised advantage estimation, 0 to 1"""
    entropy: tuple[float, float] = (0.003, 0.0003)
    """Weight of the action distribution's entropy, until the demands are strict and from then on"""
    initial_std: float = 1.0
    """Of the actions at the beginning, above 0, before ``Robot.action_scale``"""
    minimum_std: float = 0.05
    """Least spread of the actions, above 0"""
    max_gradient: float = 1.0
    """Norm to which each network's gradient is clipped, above 0"""
    estimator_hidden: tuple[int, ...] = (128, 128)
    """Units of each hidden layer of the state estimator"""
    estimator_rate: float = 1e-3
    """Learning rate of the state estimator, above 0"""
    estimator_batches: int = 8
    """Parts into which a rollout is split for the state estimator, at least 1"""
    normalise_returns: bool = True
    """Divide rewards by a running standard deviation of the discounted return"""
    bf16: Literal["auto"] | bool = "auto"
    """Matrix products in bfloat16; "auto": if this processor is faster with it, see precision.py"""
    symmetry: Literal["auto"] | bool = "auto"
    """Of two states that are mirror images, left and right swapped, the networks see one, and the
    other in the mirror; "auto": if the gait allows it. With true any other gait is refused"""


@dataclass(frozen=True)
class TrainSettings:
    """One run."""

    gait: str = "trot"
    """A gait of the library, or a gait file"""
    seed: int = 0
    """Of the networks, the robots and the commands, 0 to 2^32 - 1"""
    world: EnvSettings = field(default_factory=EnvSettings)
    learner: LearnerSettings = field(default_factory=LearnerSettings)

    def check(self) -> None:
        """Raises InputError for sizes with which no run can work."""
        learner, envs = self.learner, self.world.envs
        sizes = {
            "world.envs": envs,
            "learner.steps": learner.steps,
            "learner.rollout": learner.rollout,
            "learner.epochs": learner.epochs,
            "learner.critic_epochs": learner.critic_epochs,
            "learner.mini_batches": learner.mini_batches,
            "learner.estimator_batches": learner.estimator_batches,
        }
        if not 0 <= self.seed < 2**32:
            raise InputError(f"seed is {self.seed}, expected 0 to {2**32 - 1}")
        for name, size in sizes.items():
            if size < 1:
                raise InputError(f"{name} is {size}, expected at least 1")
        if envs > MOST_ENVS:
            raise InputError(f"world.envs is {envs}, expected at most {MOST_ENVS}")
        if envs * learner.rollout > MOST_SAMPLES:
            raise InputError(
                f"{envs} robots x {learner.rollout} steps are more than {MOST_SAMPLES} samples"
            )
        if learner.critic_epochs > learner.epochs:
            raise InputError(
                f"learner.critic_epochs is {learner.critic_epochs}, expected at most "
                f"learner.epochs, {learner.epochs}"
            )
        if envs * learner.rollout < learner.mini_batches:
            raise InputError(
                f"{envs} robots x {learner.rollout} steps cannot be split into "
                f"{learner.mini_batches} mini-batches"
            )


def paper(settings: TrainSettings) -> TrainSettings:
    """The paper's observation, rewards and learner; what we added is off."""
    rewards = replace(
        settings.world.rewards, reward_shaping="clip", bonus_source="step", power=0.0,
        velocity_y=0.0, fine_share=0.0, velocity_yaw=0.5,
        cost_scale=(1.0, 1.0), strict_above_adherence=0.0, promptness=0.0,
    )  # fmt: skip
    randomisation = replace(
        settings.world.randomisation, added_mass=(0.0, 0.0), centre_of_mass=0.0,
        strength=(1.0, 1.0), joint_damping=(0.0, 0.0), delay=(0.0, 0.0), foot_threshold=(1.0, 1.0),
    )  # fmt: skip
    world = replace(
        settings.world, profile="paper", command_interval=settings.world.episode, start="first",
        first_clearance=settings.world.clearance, first_gravity=1.0, on_violation="end",
        rewards=rewards, randomisation=randomisation,
        terminations=replace(settings.world.terminations, joint_speed=1000.0),
    )  # fmt: skip
    learner = replace(settings.learner, steps=100_000_000, normalise_returns=False, bf16=False,
                      clip_value=True, symmetry=False, rate_range=(1e-5, 1e-2),
                      entropy=(0.01, 0.01), epochs=5, critic_epochs=5, spread_rate=1.0,
                      rollout=24)  # fmt: skip
    return replace(settings, world=world, learner=learner)


class PlainSettings(TypedDict):
    """TrainSettings as YAML and JSON have them."""

    gait: str
    seed: int
    world: dict[str, object]
    learner: dict[str, object]


def to_yaml(settings: TrainSettings) -> str:
    return typed_yaml.dump(msgspec.to_builtins(settings))


def load(path: Path, base: TrainSettings) -> TrainSettings:
    """Settings from a YAML file that names only what differs from ``base``."""
    return typed_yaml.load(path, base)


def overlaid(base: TrainSettings, overlay: Mapping[str, object], source: str) -> TrainSettings:
    """``base`` with what ``overlay`` names changed. ``source`` is told in InputErrors."""
    return typed_yaml.parse(typed_yaml.dump(dict(overlay)), source, base)
