"""CAN frames of one moment as one datagram, so that they can be sent, kept and replayed as one.

Each frame takes 12 bytes, little-endian: identifier (u16, 11 bits), bus (u8, counted as in the
settings), length (u8, 0 to 8), data (8 bytes, zero beyond the length).
"""

import struct
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from rmll_onboard.state.packet_errors import BadPacket, Reason

MOST = 512
"""Frames in a datagram; a bus of 1 Mbit/s carries at most about 50 in a control period"""
_FRAME = struct.Struct("<HBB8s")
LARGEST_ID = 0x7FF


class Frame(NamedTuple):
    """A classic CAN frame with an 11-bit identifier."""

    bus: int
    id: int
    data: bytes


def pack(frames: Iterable[Frame]) -> bytes:
    """The datagram of ``frames``, in their order."""
    return b"".join(_FRAME.pack(id_, bus, len(data), data) for bus, id_, data in frames)


def unpack(datagram: bytes) -> Iterator[Frame]:
    """Inverse of :func:`pack`; raises BadPacket before the first frame if it is none."""
    if len(datagram) % _FRAME.size or len(datagram) > MOST * _FRAME.size:
        raise BadPacket(Reason.LENGTH)
    frames = list(_FRAME.iter_unpack(datagram))
    if any(id_ > LARGEST_ID or length > 8 for id_, _, length, _ in frames):
        raise BadPacket(Reason.LENGTH)
    return (Frame(bus, id_, data[:length]) for id_, bus, length, data in frames)
