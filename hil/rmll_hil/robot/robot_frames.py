"""CAN frames as the robot's side exchanges them with the daemon, and those of its IMU.

A datagram is all frames of a moment, twelve bytes each, little-endian: identifier (u16), bus (u8,
counted as in the settings), length (u8), data (8 bytes). The IMU's frames, big-endian, are told in
docs/can.md. Written a second time on purpose, see :mod:`rmll_hil.robot.a1_board_packets`.
"""

import struct
from collections.abc import Iterable

import numpy as np

from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import RobotState

BusFrame = tuple[int, int, bytes]
"""Bus, identifier, up to eight bytes"""
_SIZE, _MOST = 12, 512
_UNIT, _RAD_PER_S = 32767, 900
"""Counts of 1 in a quaternion, and of 1 rad/s"""


def join(frames: Iterable[BusFrame]) -> bytes:
    """Their datagram."""
    return b"".join(
        struct.pack("<HBB", identifier, bus, len(data)) + data.ljust(8, b"\0")
        for bus, identifier, data in frames
    )


def split(datagram: bytes) -> list[BusFrame]:
    """Inverse of :func:`join`; raises BadPacket."""
    count, odd = divmod(len(datagram), _SIZE)
    if odd or count > _MOST:
        raise BadPacket(Reason.LENGTH)
    frames = []
    for start in range(0, len(datagram), _SIZE):
        identifier, bus, length = struct.unpack_from("<HBB", datagram, start)
        if identifier >= 1 << 11 or length > 8:
            raise BadPacket(Reason.LENGTH)
        frames.append((bus, identifier, datagram[start + 4 : start + 4 + length]))
    return frames


def imu_sample(state: RobotState) -> tuple[bytes, bytes]:
    """Orientation w, x, y, z; angular velocity and the clock [ms]. Saturates."""
    orientation = np.rint((state.quaternion * _UNIT).clip(-32767, 32767)).astype(int)
    turning = np.rint((state.gyro * _RAD_PER_S).clip(-32768, 32767)).astype(int)
    return (
        struct.pack(">hhhh", *orientation.tolist()),
        struct.pack(">hhhH", *turning.tolist(), state.tick % 65536),
    )
