"""What can be set on the robot: one file, checked when it is read.

Every setting is written down once, here: type, range, default and meaning.
"""

import math
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_type_hints

import msgspec
from msgspec import Meta

from rmll_common import typed_yaml
from rmll_onboard.settings.can_settings import Can

Seconds = Annotated[float, Meta(ge=0.1, le=60)]
Rate = Annotated[float, Meta(ge=0.1, le=1000)]
Share = Annotated[float, Meta(ge=0.05, le=1)]
Kind = Literal["udp", "can"]
"""What the robot speaks"""
Angle = Annotated[float, Meta(ge=0.1, le=1.5)]


class LinkSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The wire to the robot. An A1 at its low level is 192.168.123.10:8007."""

    kind: Annotated[Kind, Meta(description="udp: an A1; can: actuators, see below")] = "udp"
    robot_address: Annotated[str, Meta(description="host:port; the default is the emulator")] = (
        "127.0.0.1:8007"
    )
    local_port: Annotated[int, Meta(ge=0, le=65535, description="0 = any free one")] = 0
    # motion_imitation and walk_in_the_park read milliseconds, the SDK's header says microseconds
    tick_us: Annotated[
        int, Meta(ge=1, le=100_000, description="[us] a count of the board's clock")
    ] = 1000
    startup_timeout: Annotated[Seconds, Meta(description="[s] to the robot's first answer")] = 5.0


class Feet(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What tells a foot on the ground from one in the air."""

    touching: Annotated[
        Share, Meta(description="share of a quarter of the weight; under more, it is in contact")
    ] = 0.2
    clear: Annotated[Share, Meta(description="the same; under less, the foot bears no load")] = 0.12

    def __post_init__(self) -> None:
        if self.clear > self.touching:
            raise ValueError(f"clear is {self.clear}, expected at most touching, {self.touching}")


class Steering(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How fast the commands may change, and how long one is good for."""

    acceleration: Annotated[Rate, Meta(description="[m/s2] of the forward speed")] = 2.0
    turning: Annotated[Rate, Meta(description="[rad/s2] of the turning speed")] = 4.0
    frequency: Annotated[Rate, Meta(description="[policy steps/s] of c_f")] = 4.0
    # what Unitree's own unitree_guide counts as released, on an A1 too
    deadband: Annotated[
        float, Meta(ge=0, le=0.5, description="share of a stick's way that counts as released")
    ] = 0.08
    silence: Annotated[
        Seconds, Meta(description="[s] without a message on the command socket: it stands")
    ] = 1.0


class Safety(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When to intervene. A fault ends in damping, for good."""

    RENAMED: ClassVar[dict[str, str]] = {"obedience_ms": "actuator_ms"}
    # most deployments trip between 0.8 and 1.2 rad
    roll_limit: Annotated[Angle, Meta(description="[rad]")] = 1.0
    pitch_limit: Annotated[Angle, Meta(description="[rad]")] = 1.0
    # Unitree's Safety keeps 0.087 away; but a gait that bounds stretches its legs up to the limit
    joint_margin: Annotated[
        float,
        Meta(ge=-0.5, le=0.5, description="[rad] to a joint's limit, in a walk; negative: past it"),
    ] = -0.05
    joint_beyond: Annotated[
        float, Meta(ge=0.01, le=1, description="[rad] past a joint's limit, at any time")
    ] = 0.15
    # the A1's own: unitree_ros const.xacro
    joint_speed: Annotated[float, Meta(ge=1, le=100, description="[rad/s]")] = 21.0
    # PowerProtect(10) of Unitree's Safety, which also says how long: more than 5 ticks
    power: Annotated[
        float, Meta(ge=50, le=5000, description="[W] of all joints, |torque x speed|")
    ] = 1000.0
    patience: Annotated[
        int,
        Meta(ge=0, le=200, description="[ticks] that margin, speed, power or heat may be too much"),
    ] = 5
    # walk_in_the_park warns at 50 and says that the motors switch off at 60
    temperature_warning: Annotated[int, Meta(ge=20, le=120, description="[°C] is told")] = 50
    temperature_limit: Annotated[int, Meta(ge=20, le=120, description="[°C] is a fault")] = 58
    stale_ms: Annotated[
        float, Meta(ge=10, le=1000, description="[ms] without a new state from the robot")
    ] = 50.0
    frozen_ms: Annotated[
        float, Meta(ge=20, le=5000, description="[ms] of new states with the same measurements")
    ] = 100.0
    orientation_error: Annotated[
        float,
        Meta(ge=0.02, le=1000, description="[rad] that orientation and gyroscope may drift apart"),
    ] = 0.1
    speed_error: Annotated[
        float,
        Meta(ge=0.02, le=1000, description="[rad] that a joint's angle and speed may drift apart"),
    ] = 0.2
    gravity_error: Annotated[
        float,
        Meta(ge=0.2, le=20, description="[m/s2] the accelerometer may be off; thrice in a walk"),
    ] = 2.0
    rpy_error: Annotated[
        float,
        Meta(ge=0.02, le=4, description="[rad] of the orientation from the board's own angles"),
    ] = 0.1
    joint_still_ms: Annotated[
        float, Meta(ge=50, le=5000, description="[ms] that one joint may read the same in a walk")
    ] = 500.0
    broken_share: Annotated[
        float, Meta(ge=0.05, le=1, description="of the ticks that brought broken datagrams only")
    ] = 0.5
    torque_error: Annotated[
        float, Meta(ge=1, le=100, description="[N·m] from what was commanded; another commander?")
    ] = 10.0
    actuator_ms: Annotated[
        float, Meta(ge=20, le=1000, description="[ms] that the motors may do something else")
    ] = 100.0
    action_steps: Annotated[
        int, Meta(ge=0, le=100, description="policy steps with an action twice out of its range")
    ] = 2
    missed_ticks: Annotated[
        int, Meta(ge=1, le=400, description="ticks left out, less one for every four in time")
    ] = 20
    # pushed on rough ground, walks that then went on had waited for up to 2; see docs/stopping.md
    stuck: Annotated[
        float, Meta(ge=2, le=100, description="times c_f without a transition: it stands")
    ] = 3.0
    remote_lost_ms: Annotated[
        float, Meta(ge=50, le=10_000, description="[ms] without the remote that leads: it sits")
    ] = 500.0
    remote_still: Annotated[
        Annotated[float, Meta(ge=1, le=3600)],
        Meta(description="[s] that a stick or button of the remote may be held without a tremble"),
    ] = 20.0

    def __post_init__(self) -> None:
        if self.temperature_warning > self.temperature_limit:
            raise ValueError(
                f"temperature_warning is {self.temperature_warning}, expected at most "
                f"temperature_limit, {self.temperature_limit}"
            )


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How long the movements between lying and walking take."""

    crouch: Annotated[Seconds, Meta(description="[s] from where the legs are to folded")] = 1.0
    rise: Annotated[Seconds, Meta(description="[s] from folded to standing")] = 2.0
    settle: Annotated[Seconds, Meta(description="[s] to the policy's own pose")] = 0.5
    plant: Annotated[
        Seconds, Meta(description="[s] after walking, until all feet are on the ground")
    ] = 0.1
    slow_down: Annotated[
        Seconds,
        Meta(description="[s] of walking on the spot before standing still or sitting down"),
    ] = 1.0
    sit: Annotated[Seconds, Meta(description="[s] down to folded legs")] = 2.0


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The flight recorder, --record."""

    max_mb: Annotated[
        float,
        Meta(ge=10, le=1e6, description="[MB] on the disk, the newest; an hour takes about 300"),
    ] = 1000.0


class Realtime(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Keeping time. What the system refuses ends the program before it sends anything."""

    RENAMED: ClassVar[dict[str, str]] = {"rehearse_us": "cache_warmup_us"}
    early_us: Annotated[
        int, Meta(ge=0, le=2000, description="[us] to wake up before a tick and watch the clock")
    ] = 200
    cache_warmup_us: Annotated[
        int,
        Meta(ge=0, le=4000, description="[us] before that, to warm up for a policy tick; 0: don't"),
    ] = 1200
    priority: Annotated[
        int, Meta(ge=0, le=99, description="of the scheduler's SCHED_FIFO; 0: an ordinary process")
    ] = 0
    lock_memory: Annotated[bool, Meta(description="no page of it may be swapped out")] = False
    core: Annotated[
        int, Meta(ge=-1, le=1023, description="the processor core to stay on; -1: any")
    ] = -1


class RuntimeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    link: LinkSettings = LinkSettings()
    feet: Feet = Feet()
    steering: Steering = Steering()
    safety: Safety = Safety()
    motion: Motion = Motion()
    record: Record = Record()
    realtime: Realtime = Realtime()
    can: Can = msgspec.field(default_factory=Can)

    def over(self, kind: Kind | None, robot_address: str | None = None) -> "RuntimeSettings":
        """The same with another link; None leaves what there is."""
        link = msgspec.structs.replace(
            self.link,
            kind=kind or self.link.kind,
            robot_address=robot_address or self.link.robot_address,
        )
        return msgspec.structs.replace(self, link=link)


def load_settings(path: Path | None) -> RuntimeSettings:
    """Read a settings file; what it leaves out keeps its default, without a file everything.

    Raises InputError for an unknown name, a wrong type or a value out of range.
    """
    return RuntimeSettings() if path is None else typed_yaml.load(path, RuntimeSettings())


def as_yaml(settings: RuntimeSettings) -> str:
    """The settings as a file, each with its meaning."""
    lines = []
    for section in msgspec.structs.fields(settings):
        values = getattr(settings, section.name)
        lines.append(f"# {type(values).__doc__}\n{section.name}:")
        hints = get_type_hints(type(values), include_extras=True)
        for name, value in msgspec.structs.asdict(values).items():
            meaning = next(m.description for m in hints[name].__metadata__ if m.description)
            if isinstance(value, dict):
                # one line an entry
                entries = _yaml(value).splitlines()
                lines += [f"  {name}:  # {meaning}", *(f"    {entry}" for entry in entries)]
                continue
            lines.append(f"  {name}: {_yaml(value, flow=True)}  # {meaning}")
    return "\n".join(lines)


def _yaml(value: Any, flow: bool | None = None) -> str:
    """One line in flow style. PyYAML ends a scalar that stands alone with a line of dots."""
    text = typed_yaml.dump(msgspec.to_builtins(value), default_flow_style=flow, width=math.inf)
    return text.removesuffix("...\n").rstrip("\n")
