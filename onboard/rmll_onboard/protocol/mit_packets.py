"""Frames of actuators that speak the MIT mini-cheetah protocol: commands and replies, pure.

Layout as in bgkatz/motorcontrol, dfki-ric's mini-cheetah-tmotor-python-can and
neurobionics/TMotorCANControl. Big-endian; a quantity is a whole number of steps between the ends
of its range, and the ranges are part of an actuator's own configuration.

    command: position 16 bits, velocity 12, kp 12, kd 12, torque 12
    reply:   motor 8 bits, position 16, velocity 12, torque 12, and what the variant adds

Arrays are (n,), one entry an actuator, in the actuators' own frames.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.state.packet_errors import BadPacket, Reason

Array = NDArray[np.float64]

ENTER = b"\xff" * 7 + b"\xfc"
"""Switches an actuator on; until then it answers and does nothing"""
EXIT = b"\xff" * 7 + b"\xfd"
"""Switches it off: it goes limp"""
# FE in the last byte would make the present position the zero position, FB clears errors of a
# Damiao. A runtime has no use for either, so this module cannot make them.

Variant = Literal["plain", "voltage", "ak", "damiao"]
"""What follows the torque in a reply. plain: nothing (mini cheetah, AK of the first series);
voltage: the bus voltage (bgkatz); ak: temperature and error (AK V2); damiao: temperatures of MOSFET
and rotor, the error shares the first byte with the motor's number."""
LENGTH: dict[Variant, int] = {"plain": 6, "voltage": 7, "ak": 8, "damiao": 8}

ERRORS: dict[Variant, dict[int, str]] = {
    "plain": {},
    "voltage": {},
    # TMotorCANControl; sources differ on 6: phases out of balance, or MOSFET too hot
    "ak": {
        1: "too hot",
        2: "over-current",
        3: "over-voltage",
        4: "under-voltage",
        5: "encoder",
        6: "phases or MOSFET",
        7: "rotor locked",
    },
    # two independent drivers have the same list
    "damiao": {
        8: "over-voltage",
        9: "under-voltage",
        10: "over-current",
        11: "MOSFET too hot",
        12: "rotor too hot",
        13: "lost its commander",
        14: "overload",
        16: "switched off",
    },
}
"""By variant and number; 16 is no number of the wire, where a Damiao says 0 for off and 1 for on"""
OFF = 16

_P_BITS, _BITS = 16, 12
_P_TOP, _TOP = (1 << _P_BITS) - 1, (1 << _BITS) - 1


@dataclass(frozen=True)
class Ranges:
    """Ends of the ranges, (n,): position, velocity and torque from -end to end, gains from 0."""

    position: Array
    """[rad]"""
    velocity: Array
    """[rad/s]"""
    torque: Array
    """[N·m]"""
    kp: Array
    """[N·m/rad]"""
    kd: Array
    """[N·m·s/rad]"""


class MitCommands(NamedTuple):
    """What n actuators are told: torque + kp (position - p) + kd (velocity - v)."""

    position: Array
    velocity: Array
    kp: Array
    kd: Array
    torque: Array


class Reply(NamedTuple):
    """What one actuator answers. The first three are steps from the low end of the range."""

    position: int
    velocity: int
    torque: int
    temperature: int
    """[°C], 0 if the variant does not tell; the hotter one of two"""
    error: int
    """0 for none, else a number of :data:`ERRORS` or one that is not listed"""


def encode_commands(ranges: Ranges, commands: MitCommands) -> list[bytes]:
    """A frame of 8 bytes an actuator.

    Saturates, and rounds to the nearest step; the actuators' own code cuts off. Raises ValueError
    for what is no number.

    The highest position is out of reach by one step: with it, a frame could begin as the special
    ones do, and an actuator could take a command for the order to move its zero.
    """
    position = np.minimum(_steps(commands.position, ranges.position, _P_TOP), _P_TOP - 1)
    words = position.astype(np.uint64)
    for values, end in (
        (commands.velocity, ranges.velocity),
        (commands.kp - ranges.kp / 2, ranges.kp / 2),
        (commands.kd - ranges.kd / 2, ranges.kd / 2),
        (commands.torque, ranges.torque),
    ):
        words = words << np.uint64(_BITS) | _steps(values, end, _TOP)
    data = words.astype(">u8").tobytes()
    return [data[start : start + 8] for start in range(0, len(data), 8)]


def first_bytes(motor: int, variant: Variant) -> list[int]:
    """What a reply of the actuator ``motor`` may begin with."""
    if variant != "damiao":
        return [motor]
    return [status << 4 | motor & 0x0F for status in range(16)]


def decode_reply(data: bytes, variant: Variant) -> Reply:
    """What a reply tells; raises BadPacket for a wrong length."""
    if len(data) != LENGTH[variant]:
        raise BadPacket(Reason.LENGTH)
    measured = int.from_bytes(data[1:6])
    temperature = error = 0
    match variant:
        case "ak":
            temperature, error = int.from_bytes(data[6:7], signed=True), data[7]
        case "damiao":
            status = data[0] >> 4
            error = {1: 0, 0: OFF}.get(status, status)
            temperature = min(127, max(data[6], data[7]))
    return Reply(
        measured >> 2 * _BITS, measured >> _BITS & _TOP, measured & _TOP, temperature, error
    )


def measured(ranges: Ranges, steps: NDArray) -> tuple[Array, Array, Array]:
    """(3, n) steps of replies as position [rad], velocity [rad/s] and torque [N·m]."""
    return (
        _value(steps[0], ranges.position, _P_TOP),
        _value(steps[1], ranges.velocity, _TOP),
        _value(steps[2], ranges.torque, _TOP),
    )


def _steps(values: Array, end: Array, top: int) -> NDArray[np.uint64]:
    """From -end (0) to end (top); raises ValueError for what is no number."""
    share = (values / end).clip(-1.0, 1.0) * 0.5 + 0.5
    if np.isnan(share).any():
        raise ValueError("a frame carries numbers only")
    return np.rint(share * top).astype(np.uint64)


def _value(steps: NDArray, end: Array, top: int) -> Array:
    return steps * (2.0 / top) * end - end
