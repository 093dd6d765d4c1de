"""Every number of a training run, in one tree of frozen dataclasses, kept as YAML beside the run.

The defaults are what ``rmll-train`` uses; ``paper()`` gives the values of the paper and of its
authors' code, with our departures turned off.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypedDict

import msgspec

from rmll_common import typed_yaml
from rmll_common.errors import InputError
from rmll_contract.observation import Profile
from rmll_robots import ground

MOST_ENVS, MOST_SAMPLES = 2**16, 2**24
"""Robots, and steps of all of them in a rollout: no memory has room for what a slip asks for"""


@dataclass(frozen=True)
class Rewards:
    """Terms of R_walk: weights of the paper's Table 1, per second."""

    velocity_x: float = 1.0
    """exp(-(c_x - v_x)^2 / width)"""
    velocity_yaw: float = 0.7
    """exp(-(c_w - w_z)^2 / width). The paper has 0.5, at which robots sway around their course, and
    a pace that goes fast does not turn; at 1 a half_bound comes later"""
    width: float = 0.25
    fine_share: float = 0.2
    """Half of each tracking reward is a narrower kernel, exp(-(error / (share x largest
    command))^2). With the wide one alone, which is flat where errors are small, a trot is useful
    after twice the steps. 0 = off"""
    velocity_z: float = -2.0
    angular_velocity_xy: float = -0.05
    torque: float = -0.0002
    joint_acceleration: float = -2.5e-7
    air_time: float = 1.0
    """sum of (time in the air - 0.5 s) at touch-down"""
    action_rate: float = -0.01
    pressure: tuple[float, float] = (0.2, 1.5)
    """Range of the factor on all costs. Within it the factor grows while robots hold the gait and
    their speed, and shrinks while they do not: first the gait emerges, then it becomes efficient.
    Above 1 its cube narrows ``width`` too, so that efficiency is not bought with errors of
    velocity. Equal ends turn this off"""
    hold_adherence: float = 0.8
    """The factor grows above this adherence ..."""
    hold_vx_error: float = 0.2
    """... and below this error [m/s], both with exploration and pushes. On rough ground 0.13 was
    never reached, and robots that held their gait went on to burn 220 J/m"""
    strict_above: float = 0.85
    """Adherence from which on, for good, the limits of ``Terminations`` hold and
    ``EnvSettings.mistakes`` says what reject edges do. Until then forbidden contacts only earn
    nothing, and an episode ends when the robot is down: ended at the first wrong step, it never
    learns the second right one.
    0 = strict from the beginning, as in the paper"""
    joint_limit: float = -10.0
    """sum of the radians beyond 90 % of the joint range (in the authors' code, not in the paper)"""
    power: float = -0.01
    """sum |torque x joint velocity| / (v + 0.5 m/s) [N], where v is the speed in the wanted
    direction, at most |c_x|: about the energy per metre, so that it weighs as much at every speed
    and going too slowly saves little; ours"""
    velocity_y: float = -1.0
    """v_y^2; ours"""
    foot_lift: float = 0.0
    """sum over feet of what they are higher than ``free_lift`` [m]; ours. At -8 a trot needs a
    sixth less energy, but hard gaits come later: of 3 M steps a half_bound adheres at 0.88 to 0.90,
    and at 0.91 to 0.93 without"""
    free_lift: float = 0.05
    """[m] above the ground, to which lifting a foot costs nothing"""
    form: Literal["exp", "clip"] = "exp"
    """How costs lower the tracking reward. "clip" = max(0, sum of all terms): the paper's code.
    "exp" = tracking x exp(costs), which stays positive, so that the very first transitions of an
    untrained policy already pay their bonus (Ji et al. 2022)."""
    bonus: float = 1000.0
    """b: a transition multiplies the reward of its step"""
    bonus_on: Literal["dwell", "step"] = "dwell"
    """What a transition's bonus multiplies: R_walk of its step (the paper), or the mean of R_walk
    since the last transition, so that the motion between the poses counts as well"""
    promptness: float = 2.0
    """A late transition's bonus is multiplied by (dwell / steps waited) to this power. What a delay
    of a step costs in bonuses a second alone is lost in their noise. 0 = off"""


@dataclass(frozen=True)
class ObservationNoise:
    """Half-widths of the uniform noise on observations (legged_gym)."""

    joint_position: float = 0.01
    joint_velocity: float = 1.5
    projected_gravity: float = 0.05
    angular_velocity: float = 0.2


@dataclass(frozen=True)
class Randomisation:
    """What differs between simulated robots, and what disturbs them."""

    friction: tuple[float, float] = (0.5, 1.25)
    added_mass: tuple[float, float] = (-1.0, 2.0)
    """[kg] on the trunk; a real A1 carries a battery and a computer"""
    centre_of_mass: float = 0.03
    """[m] of the trunk, at most, along each axis"""
    strength: tuple[float, float] = (0.9, 1.1)
    """Factor on the servos' gains"""
    joint_damping: tuple[float, float] = (0.0, 0.15)
    """[N·m·s/rad] in place of dry friction. At 0.08 a bound is as much slower as with 0.2 N·m"""
    delay: tuple[float, float] = (0.0, 0.02)
    """[s] from an action to its effect at the joints, in physics steps"""
    foot_threshold: tuple[float, float] = (1.0, 8.0)
    """Factor on ``EnvSettings.contact_force`` for each foot: foot sensors miss a light touch"""
    push_interval: float = 15.0
    """[s] on average; each robot is pushed at moments of its own. At fixed ones, as in legged_gym,
    a robot that keeps its rhythm would meet every push with the same feet on the ground"""
    push_velocity: float = 1.0
    """[m/s] largest change of the base's velocity along x and along y"""
    initial_joint: float = 0.1
    """[rad] around the default pose"""
    initial_velocity: float = 0.3
    """[m/s], [rad/s] of the base"""
    noise: ObservationNoise = field(default_factory=ObservationNoise)


@dataclass(frozen=True)
class GroundSettings(ground.Ground):
    """What robots stand on, and when they are sent to harder ground."""

    harder_above: float = 0.8
    """Adherence of a whole episode from which on the robot's next tile is a level harder; that of a
    robot that fell is a level easier"""


@dataclass(frozen=True)
class Terminations:
    """Limits that end an episode before its time, or as ``EnvSettings.mistakes`` says."""

    base_height: float = 0.25
    """[m] lower than this"""
    base_down: float = 0.15
    """[m] lower than this: the robot is down, which always ends the episode"""
    knee_height: float = 0.03
    """[m] a knee lower than this: the robot is down too, for more than its feet touch the ground"""
    joint_margin: float = 0.05
    """[rad] beyond a joint's limit"""
    action_rate: float = 40.0
    """sum of |change of action|"""
    foot_height: float = 0.25
    """[m] higher than this"""
    joint_speed: float = 1.0
    """Share of the robot's joint speed limit, beyond which its daemon stops it. A cost on it from
    the beginning made speeds be followed later, and joints no slower"""


@dataclass(frozen=True)
class EnvSettings:
    """The learning environment."""

    profile: Profile = "imu"
    envs: int = 1024
    episode: float = 20.0
    """[s]"""
    command_interval: float = 10.0
    """[s] between two draws of the commands within an episode"""
    start: Literal["any", "first"] = "any"
    """State of the automaton in which an episode begins until the demands are strict. From any
    state, each pose of the gait is tried from the first episodes on, not only once all those before
    it are mastered; later, and on the robot, the first state is where a standing robot begins"""
    contact_force: float = 1.0
    """[N]"""
    clearance: float = 0.03
    """[m] from which on a foot counts as in the air ..."""
    first_clearance: float = 0.01
    """... and that at the beginning, from where it grows with the adherence until the demands are
    strict. Chance does not lift all feet of a pronk by 3 cm at once"""
    first_gravity: float = 0.3
    """Share of the earth's gravity at the beginning, which grows in the same way. What chance moves
    takes light robots off the ground: with all feet at once, or with the two that bear most"""
    mistakes: Literal["end", "unpaid"] = "unpaid"
    """What a broken limit of ``Terminations`` or a reject edge does while the robot is not down: it
    ends the episode (the paper), or its steps earn nothing and the automaton waits, as it does on
    the robot. Ended where a push has only bent its knees, a robot never learns the way back"""
    ground: GroundSettings = field(default_factory=GroundSettings)
    rewards: Rewards = field(default_factory=Rewards)
    randomisation: Randomisation = field(default_factory=Randomisation)
    terminations: Terminations = field(default_factory=Terminations)


@dataclass(frozen=True)
class LearnerSettings:
    """PPO and the estimator."""

    steps: int = 12_000_000
    """environment steps in all"""
    rollout: int = 12
    """policy steps a simulation between two updates. With 24, as rsl-rl's, a gait takes twice the
    samples; with 8 a bound was not found within 2 M steps, in one run"""
    epochs: int = 2
    """of the actor. rsl-rl has 5; two, at a higher rate, learn as much in less time"""
    critic_epochs: int = 1
    """With two, gaits took about as many samples, each in a tenth more time. In the actor's other
    epochs its batches are shared out between both threads"""
    mini_batches: int = 4
    hidden: tuple[int, ...] = (256, 256, 256)
    learning_rate: float = 1e-3
    """at the beginning"""
    rate_range: tuple[float, float] = (1e-4, 4e-3)
    """Bounds within which the learning rate follows ``desired_kl``. With rsl-rl's own, 1e-5 to
    1e-2, rare bonuses drive it to the lower one, where nothing is learned"""
    spread_rate: float = 5.0
    """Factor on the learning rate of the action distribution's spread. Adam moves a logarithm by no
    more than its rate a step: at 1, exploration outlives its use by millions of steps"""
    desired_kl: float = 0.01
    clip: float = 0.2
    clip_value: bool = False
    gamma: float = 0.99
    lam: float = 0.95
    entropy: tuple[float, float] = (0.003, 0.0003)
    """Weight of the action distribution's entropy, until the demands are strict and from then on:
    the noise that finds a gait hides what an efficient one would gain"""
    initial_std: float = 1.0
    minimum_std: float = 0.05
    max_gradient: float = 1.0
    estimator_hidden: tuple[int, ...] = (128, 128)
    estimator_rate: float = 1e-3
    estimator_batches: int = 8
    normalise_returns: bool = True
    """divide rewards by a running standard deviation of the discounted return"""
    bf16: Literal["auto"] | bool = "auto"
    """matrix products in bfloat16; "auto": if this processor is faster with it, see precision.py"""
    symmetry: Literal["auto"] | bool = "auto"
    """Of two states that are mirror images, left and right swapped, the networks see one, and the
    other in the mirror; "auto": if the gait allows it"""


@dataclass(frozen=True)
class TrainSettings:
    """One run."""

    gait: str = "trot"
    seed: int = 0
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
        settings.world.rewards, form="clip", bonus_on="step", power=0.0, velocity_y=0.0,
        fine_share=0.0, velocity_yaw=0.5,
        pressure=(1.0, 1.0), strict_above=0.0, promptness=0.0,
    )  # fmt: skip
    randomisation = replace(
        settings.world.randomisation, added_mass=(0.0, 0.0), centre_of_mass=0.0,
        strength=(1.0, 1.0), joint_damping=(0.0, 0.0), delay=(0.0, 0.0), foot_threshold=(1.0, 1.0),
    )  # fmt: skip
    world = replace(
        settings.world, profile="paper", command_interval=settings.world.episode, start="first",
        first_clearance=settings.world.clearance, first_gravity=1.0, mistakes="end",
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
