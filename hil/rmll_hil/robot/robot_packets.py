"""What an emulated robot understands and says: the A1's datagrams, or others in their place."""

from collections.abc import Callable, Sequence
from typing import Protocol

from rmll_hil.robot.a1_board_packets import VENDOR_SIGNS, A1BoardPackets
from rmll_hil.robot.motor_board import BRAKE_KD
from rmll_onboard.state.robot_state import MotorCommand, RobotState


class RobotPackets(Protocol):
    """The robot's end of a wire."""

    passive_kd: float
    """[N·m·s/rad] of a joint that nobody commands"""

    def hear(self, datagram: bytes, measure: Callable[[], RobotState]) -> MotorCommand:
        """The command in a datagram; raises BadPacket. ``measure`` reads the sensors now."""
        ...

    def tell(self, state: RobotState) -> bytes:
        """The datagram that the robot sends."""
        ...


class A1Robot:
    """A board that speaks for all joints."""

    passive_kd = BRAKE_KD

    def __init__(self, signs: Sequence[int] = VENDOR_SIGNS) -> None:
        """``signs`` (12,) as of :class:`rmll_hil.robot.a1_board_packets.A1BoardPackets`."""
        self._packets = A1BoardPackets(signs)

    def hear(self, datagram: bytes, measure: Callable[[], RobotState]) -> MotorCommand:
        return self._packets.decode_command(datagram)

    def tell(self, state: RobotState) -> bytes:
        return self._packets.encode_state(state)
