"""The fault plan: what goes wrong on the emulated robot and on its network, and when.

A plan is a YAML list. Every entry names its fault, begins ``at`` so many seconds of the robot's own
clock (which starts with the first command) and lasts ``seconds``, or to the end::

    - {fault: network, loss: 0.01, jitter_ms: 5, duplicates: 0.01, reorder: 0.01}
    - {fault: push, at: 6, seconds: 0.1, force: [0, 150, 0]}
    - {fault: stuck_joint, at: 8, joint: FR_calf_joint}
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta

from rmll_common import typed_yaml, yaml_document
from rmll_common.yaml_document import Value
from rmll_hil.robot.a1_joystick import BUTTONS
from rmll_robots import Robot

MAX_FAULTS = 1000

Share = Annotated[float, Meta(ge=0, le=1)]
Millis = Annotated[float, Meta(ge=0, le=10_000)]
Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Stick = Annotated[float, Meta(ge=-1, le=1)]
Vector = tuple[Number, Number, Number]
Wild = Annotated[float, Meta(ge=-3e38, le=3e38)]
"""What 32 bits can hold"""


def _snake_case(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).lstrip("_")


class PlannedFault(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="fault",
    tag=_snake_case,
):
    """What all faults have."""

    at: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """[s] of the robot's clock"""
    seconds: Annotated[float, Meta(gt=0, le=1e6)] | None = None
    """[s], None: to the end"""

    def active(self, now_ms: int) -> bool:
        """Whether it is there at ``now_ms`` of the robot's clock."""
        end = math.inf if self.seconds is None else round((self.at + self.seconds) * 1000)
        return round(self.at * 1000) <= now_ms < end


class Network(PlannedFault, frozen=True):
    """What happens to datagrams on their way. A loss of 1 from the robot is a board gone silent."""

    direction: Literal["both", "to_robot", "from_robot"] = "both"
    loss: Share = 0.0
    """Share that never arrives"""
    duplicates: Share = 0.0
    """Share that arrives twice"""
    reorder: Share = 0.0
    """Share held back so long that others overtake it"""
    corrupt: Share = 0.0
    """Share with some bits flipped, or with its end cut off"""
    delay_ms: Millis = 0.0
    jitter_ms: Millis = 0.0
    """Up to so much more delay, each datagram's own, so that they overtake each other too"""


class Frozen(PlannedFault, frozen=True):
    """The board sends its last state again and again."""

    clock_runs: bool = False
    """With a tick that goes on"""


class _Joint(PlannedFault, frozen=True):
    joint: str


class StuckJoint(_Joint, frozen=True):
    """The joint's encoder stands still, its speed reads 0."""


class NanJoint(_Joint, frozen=True):
    """The joint's angle is no number."""


class WrongJoint(_Joint, frozen=True):
    """The joint's sensors are off by so much."""

    q: Number = 0.0
    """[rad]"""
    dq: Number = 0.0
    """[rad/s]"""
    tau: Number = 0.0
    """[N·m]"""


class HotJoint(_Joint, frozen=True):
    """The motor gets warmer."""

    rate: Annotated[float, Meta(ge=0, le=1000)]
    """[°C/s]"""


class BrakedJoint(_Joint, frozen=True):
    """The board takes the motor out of service; it brakes.

    Mode 8 is what an A1 was seen to report then (SDK issue 54).
    """

    mode: Annotated[int, Meta(ge=0, le=255)] = 8


class FlippedImu(PlannedFault, frozen=True):
    """The orientation is that of a robot on its back."""


class WrongGyro(PlannedFault, frozen=True):
    """The gyroscope is off by so much."""

    rate: tuple[Wild, Wild, Wild]
    """[rad/s]"""


SensorName = Literal[
    "orientation", "gyroscope", "accelerometer", "rpy", "joint_angles", "joint_speeds",
    "joint_torques", "feet",
]  # fmt: skip


class FrozenSensor(PlannedFault, frozen=True):
    """A sensor goes on with what it read when the fault began, while all others are live."""

    sensors: Annotated[tuple[SensorName, ...], Meta(min_length=1)]


class DeadSensor(PlannedFault, frozen=True):
    """A sensor reads 0; an orientation then is no rotation."""

    sensors: Annotated[tuple[SensorName, ...], Meta(min_length=1)]


class DeadImu(PlannedFault, frozen=True):
    """As after a power fault: the orientation of a level robot, and 0 for all else."""


class WrongRpy(PlannedFault, frozen=True):
    """The board's own roll, pitch and yaw are off by so much."""

    rpy: Vector
    """[rad]"""


class SwappedQuaternion(PlannedFault, frozen=True):
    """The orientation's parts come in the order x, y, z, w; all else is in order."""


class NoisyFeet(PlannedFault, frozen=True):
    """The feet's sensors read anything between two values, whatever the load."""

    low: Annotated[int, Meta(ge=-32768, le=32767)] = 18
    high: Annotated[int, Meta(ge=-32768, le=32767)] = 29


class DeadFoot(PlannedFault, frozen=True):
    """The foot's force sensor reads the same whatever the load."""

    foot: str
    reads: Annotated[int, Meta(ge=-32768, le=32767)] = 0


class Push(PlannedFault, frozen=True):
    """A force on the middle of the trunk, in the world's directions."""

    force: Vector
    """[N]"""


class Kick(PlannedFault, frozen=True):
    """The base's velocity changes at once; ``seconds`` has no meaning here."""

    velocity: tuple[Number, Number]
    """[m/s], along the world's x and y"""


class OtherCommander(PlannedFault, frozen=True):
    """Somebody else commands the board too, at 500 Hz: the legs into a pose."""

    pose: Literal["stand", "crouch"] = "stand"
    kp: Annotated[float, Meta(ge=0, le=500)] = 60.0
    kd: Annotated[float, Meta(ge=0, le=20)] = 3.0


class RemoteButtons(PlannedFault, frozen=True, tag="remote"):
    """Buttons and sticks of the wireless remote; released while no entry holds them."""

    buttons: tuple[str, ...] = ()
    lx: Stick = 0.0
    ly: Stick = 0.0
    rx: Stick = 0.0
    ry: Stick = 0.0


class RemoteLost(PlannedFault, frozen=True):
    """The remote's bytes are all zero."""


AnyFault = (
    Network | Frozen | StuckJoint | NanJoint | WrongJoint | HotJoint | BrakedJoint | FlippedImu
    | WrongGyro | FrozenSensor | DeadSensor | DeadImu | WrongRpy | SwappedQuaternion
    | NoisyFeet | DeadFoot
    | Push | Kick | OtherCommander | RemoteButtons | RemoteLost
)  # fmt: skip
Plan = tuple[AnyFault, ...]

KINDS: dict[str, type[PlannedFault]] = {
    str(kind.__struct_config__.tag): kind for kind in get_args(AnyFault)
}


def load_plan(path: Path, robot: Robot) -> Plan:
    """Read and check a fault plan; raises InputError for whatever is wrong with it."""
    return read_plan(yaml_document.read_text(path), str(path), robot)


def parse_plan(plain: Sequence[Mapping[str, object]], robot: Robot) -> Plan:
    """The plan that plain lists and dictionaries stand for; raises InputError."""
    return read_plan(typed_yaml.dump([dict(entry) for entry in plain]), "plan", robot)


def read_plan(text: str, source: str, robot: Robot) -> Plan:
    """The plan in a YAML text, which errors call ``source``; raises InputError."""
    value = yaml_document.parse(text, source)
    entries = [] if value is None else value.items(0, MAX_FAULTS)
    return tuple(_fault(entry, robot) for entry in entries)


def _fault(value: Value, robot: Robot) -> AnyFault:
    if "fault" not in (entries := value.mapping()):
        raise value.error(f"key 'fault' is missing, one of {', '.join(KINDS)}")
    kind = KINDS.get(name := entries["fault"].text())
    if kind is None:
        raise entries["fault"].error(f"unknown fault {name!r}, expected one of {', '.join(KINDS)}")
    fault = typed_yaml.convert(value, kind)
    for key, known in {
        "joint": robot.joint_names,
        "foot": robot.foot_names,
        "buttons": BUTTONS,
    }.items():
        if strange := set(_listed(fault, key)) - set(known):
            raise entries[key].error(f"found {min(strange)!r}, expected one of {', '.join(known)}")
    return fault


def _listed(fault: PlannedFault, name: str) -> tuple[str, ...]:
    value = getattr(fault, name, ())
    return (value,) if isinstance(value, str) else value
