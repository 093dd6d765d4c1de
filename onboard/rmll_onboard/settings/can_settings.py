"""What has to be said of a robot on CAN: its buses, its actuators, its IMU."""

from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from rmll_onboard.protocol.mit_packets import Variant, first_bytes
from rmll_robots import A1

Name = Annotated[str, Meta(min_length=1, max_length=64)]
Range = Annotated[float, Meta(gt=0, le=1e4)]
"""Upper end of a range; the lower end is its negative, or 0 for a gain"""
Identifier = Annotated[int, Meta(ge=0, le=0x7FF)]

LOCAL = "ff01:"
"""IPv6 groups of this prefix are interface-local: the kernel keeps their packets on the machine"""


class Bus(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A bus as python-can opens it."""

    interface: Name
    channel: Name
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    """[bit/s]; SocketCAN has it from ``ip link`` instead"""
    port: Annotated[int, Meta(ge=1024, le=65535)] = 43113
    """Of udp_multicast alone"""

    def __post_init__(self) -> None:
        if self.interface == "udp_multicast" and not self.channel.lower().startswith(LOCAL):
            raise ValueError(
                f"udp_multicast is for the emulator on this machine: channel is {self.channel!r}, "
                f"expected a group {LOCAL}..."
            )


class Model(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A kind of actuator: its ranges, as they are set in the actuator itself, and its replies."""

    position: Range
    """[rad]"""
    velocity: Range
    """[rad/s]"""
    torque: Range
    """[N·m]"""
    kp: Range = 500.0
    """[N·m/rad]"""
    kd: Range = 5.0
    """[N·m·s/rad]"""
    reply: Variant = "plain"
    """What follows the torque in a reply, see :mod:`rmll_onboard.protocol.mit_packets`"""


class Actuator(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One joint's: joint angle = sign x actuator angle + offset."""

    bus: Name
    """Its name in ``Can.buses``"""
    id: Annotated[int, Meta(ge=1, le=255)]
    """Identifier of the frames that command it"""
    model: Name
    """Its name in ``Can.models``"""
    reply_id: Identifier = 0
    """Identifier of its replies: its master's"""
    sign: Literal[-1, 1] = 1
    """-1: it turns against the joint"""
    offset: Annotated[float, Meta(ge=-12.6, le=12.6)] = 0.0
    """[rad]"""


class Imu(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The orientation sensor, see :mod:`rmll_onboard.protocol.can_imu`; it takes id and id + 1."""

    bus: Name
    """Its name in ``Can.buses``"""
    id: Annotated[int, Meta(ge=0, le=0x7FE)] = 0x100
    """Identifier of its first frame"""


def _buses() -> dict[str, Bus]:
    return {
        leg.lower(): Bus("udp_multicast", f"{LOCAL}:{number + 1}", port=43113 + number)
        for number, leg in enumerate(A1.foot_names)
    }


def _models() -> dict[str, Model]:
    # the only AK whose torque range holds the A1's 33.5 N·m; ranges as TMotorCANControl has them
    return {"AK10-9": Model(position=12.5, velocity=50.0, torque=65.0, reply="ak")}


def _actuators() -> dict[str, Actuator]:
    return {
        joint: Actuator(bus=joint[:2].lower(), id=number % 3 + 1, model="AK10-9")
        for number, joint in enumerate(A1.joint_names)
    }


class Can(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The buses of --link can; as printed, those of the emulator on this machine."""

    buses: Annotated[
        dict[Name, Bus],
        Meta(min_length=1, max_length=32, description="by a name of one's own, see python-can"),
    ] = msgspec.field(default_factory=_buses)
    models: Annotated[
        dict[Name, Model],
        Meta(min_length=1, description="kinds of actuators: ends of their ranges, form of reply"),
    ] = msgspec.field(default_factory=_models)
    actuators: Annotated[
        dict[Name, Actuator],
        Meta(description="by joint; joint angle = sign x actuator angle + offset [rad]"),
    ] = msgspec.field(default_factory=_actuators)
    imu: Annotated[Imu, Meta(description="takes the identifiers id and id + 1")] = Imu("fr")
    reply_timeout_ms: Annotated[
        float, Meta(ge=10, le=1000, description="[ms] without an answer of an actuator or the IMU")
    ] = 50.0

    def __post_init__(self) -> None:
        """Raises ValueError for a name that is not there, or identifiers that clash."""
        _known("imu", self.imu.bus, "bus", self.buses)
        for joint, actuator in self.actuators.items():
            _known(f"actuator {joint}", actuator.bus, "bus", self.buses)
            _known(f"actuator {joint}", actuator.model, "model", self.models)
        ports = [bus.port for bus in self.buses.values() if bus.interface == "udp_multicast"]
        _all_different("two udp_multicast buses have port", ports)
        for bus in self.buses:
            self._check_identifiers(bus)

    def _check_identifiers(self, bus: str) -> None:
        """Who sends a frame on ``bus``, and to whom, must show in its identifier."""
        here = [actuator for actuator in self.actuators.values() if actuator.bus == bus]
        _all_different(f"bus {bus}: two actuators have id", [actuator.id for actuator in here])
        answers = [
            (actuator.reply_id, first)
            for actuator in here
            for first in first_bytes(actuator.id, self.models[actuator.model].reply)
        ]
        _all_different(f"bus {bus}: two actuators may answer with (reply_id, first byte)", answers)
        listening = {actuator.id for actuator in here}
        imu = [self.imu.id, self.imu.id + 1] if self.imu.bus == bus else []
        talking = {actuator.reply_id for actuator in here} | set(imu)
        if clash := listening & talking:
            raise ValueError(f"bus {bus}: id {min(clash)} is that of a command and of an answer")
        if clash := set(imu) & {actuator.reply_id for actuator in here}:
            raise ValueError(f"bus {bus}: id {min(clash)} is that of the IMU and of a reply")


def _known(who: str, name: str, kind: str, known: Iterable[str]) -> None:
    if name not in known:
        raise ValueError(f"{who}: unknown {kind} {name!r}; known: {', '.join(known)}")


def _all_different(complaint: str, values: Iterable[object]) -> None:
    value, times = max(Counter(values).items(), key=lambda item: item[1], default=(None, 0))
    if times > 1:
        raise ValueError(f"{complaint} {value}")
