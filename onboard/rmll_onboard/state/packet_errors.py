"""Why a packet from the robot is not believed."""

from enum import StrEnum


class Reason(StrEnum):
    """Why a datagram is refused."""

    LENGTH = "length"
    LEVEL = "level flag"
    CRC = "checksum"
    NOT_FINITE = "not finite"
    LATE = "late"
    REPEATED = "repeated"
    AHEAD = "ahead of time"


class BadPacket(ValueError):
    """A datagram that must not be believed."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(f"bad packet: {reason}")
        self.reason = reason
