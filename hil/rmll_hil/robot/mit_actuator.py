"""An actuator's end of the MIT mini-cheetah protocol: it reads commands and writes replies.

After bgkatz's firmware (can.c), with the replies of its descendants. Written a second time on
purpose, see :mod:`rmll_hil.robot.a1_board_packets`. All in the actuator's own frame.
"""

from typing import NamedTuple

from rmll_onboard.settings.can_settings import Model

SWITCH_ON, SWITCH_OFF = bytes.fromhex("fffffffffffffffc"), bytes.fromhex("fffffffffffffffd")
SPECIAL = b"\xff" * 7
"""What these two, and those that move the zero or clear errors, begin with"""


class Target(NamedTuple):
    """What an actuator does: torque + kp (position - p) + kd (velocity - v)."""

    position: float = 0.0
    velocity: float = 0.0
    kp: float = 0.0
    kd: float = 0.0
    torque: float = 0.0


class MitActuator:
    """One actuator's ranges, and what they make of bytes."""

    def __init__(self, model: Model, number: int) -> None:
        self._model = model
        self._number = number

    def read(self, data: bytes) -> Target:
        """A command of eight bytes."""
        model = self._model
        return Target(
            position=_signed(data[0] << 8 | data[1], 65535, model.position),
            velocity=_signed(data[2] << 4 | data[3] >> 4, 4095, model.velocity),
            kp=((data[3] & 15) << 8 | data[4]) / 4095 * model.kp,
            kd=(data[5] << 4 | data[6] >> 4) / 4095 * model.kd,
            torque=_signed((data[6] & 15) << 8 | data[7], 4095, model.torque),
        )

    def reply(
        self,
        measured: tuple[float, float, float],
        temperature: int,
        error: int,
        on: bool,
    ) -> bytes:
        """``measured`` is position, velocity and torque; rounds to the nearest step, saturates."""
        model, first = self._model, self._number
        position = _count(measured[0], 65535, model.position)
        velocity = _count(measured[1], 4095, model.velocity)
        torque = _count(measured[2], 4095, model.torque)
        match model.reply:
            case "plain":  # mini cheetah, AK of the first series
                rest = b""
            case "voltage":  # bgkatz: of the bus, not emulated
                rest = b"\0"
            case "ak":  # AK V2
                rest = bytes([min(max(temperature, -128), 127) & 255, error])
            case "damiao":
                first = (error or int(on)) << 4 | first & 15
                rest = bytes(2 * [min(max(temperature, 0), 127)])
        return bytes(
            [
                first,
                position >> 8,
                position & 255,
                velocity >> 4,
                (velocity & 15) << 4 | torque >> 8,
                torque & 255,
                *rest,
            ]
        )


def _signed(count: int, top: int, end: float) -> float:
    """0 is -end, ``top`` is end."""
    return count * (2 / top) * end - end


def _count(value: float, top: int, end: float) -> int:
    share = min(max(value / end, -1.0), 1.0) * 0.5 + 0.5
    return round(share * top)
