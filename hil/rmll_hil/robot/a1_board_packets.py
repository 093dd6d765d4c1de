"""The board's end of the A1's datagrams: LowCmd is read here, LowState is written.

From the vendor's header (unitree_legged_sdk v3.2 to 3.3.4: comm.h, quadruped.h) and from what its
library was seen to send and to take. It shares nothing with the daemon's codec on purpose: what one
of the two has wrong, the other does not undo.

Little-endian, packed. Both packets begin with the level flag (0xFF), version, robot's number,
serial number and bandwidth, have twenty motors of which twelve exist, and end with four reserved
bytes and a checksum over all whole words before it.
"""

import struct
from collections.abc import Sequence
from math import isfinite

import numpy as np

from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MotorCommand, RobotState
from rmll_robots import A1

MOTORS = [
    f"{leg}_{joint}_joint" for leg in ("FR", "FL", "RR", "RL") for joint in ("hip", "thigh", "calf")
]
"""What is in the slots from 0 on: FR_0, FR_1, FR_2, FL_0, ... in the vendor's header"""
VENDOR_SIGNS = (1,) * 12
"""Which way a motor's angle, speed and torque count in its slot, against the joint's own"""

_LEVEL_LOW = 255
_HEADER = "<BHHIB"
_COMMAND = struct.Struct(_HEADER + "Bffhhh12x" * 20 + "12s40s4xI")
"""A motor: mode, q, dq, torque, Kp, Kd; then the lamps, the remote, the checksum"""
_STATE = struct.Struct(
    _HEADER + "4f3f3f3fb" + "Bffhhffhb8x" * 12 + "256x" + "4h4h" + "I40s" + "4xI"
)
"""Quaternion, gyroscope, accelerometer, roll pitch yaw, temperature; a motor: mode, q, dq, ddq,
torque, the same three raw, temperature; foot force, its estimate, clock, remote, checksum"""
_TORQUE, _KP, _KD = 256, 32, 16
"""Counts of 1 N·m, 1 N·m/rad, 1 N·m·s/rad"""
_TICK, _FIRST_Q, _MOTOR_SIZE = 719, 64, 32
"""Offsets and size [bytes] in a state"""


class A1BoardPackets:
    """Reads and writes in the slots' order and signs; joint arrays are in the robot's own order."""

    def __init__(self, signs: Sequence[int] = VENDOR_SIGNS) -> None:
        """``signs`` (12,), a slot's: other ones are a robot that is built or wired otherwise."""
        joints = [A1.joint_names.index(name) for name in MOTORS]
        self._slots = list(zip(joints, signs, strict=True))
        self._slot_of = np.argsort(joints)
        self._sign = np.array(signs, float)[self._slot_of]

    def decode_command(self, datagram: bytes) -> MotorCommand:
        """Raises BadPacket for what a board would drop."""
        if len(datagram) != _COMMAND.size:
            raise BadPacket(Reason.LENGTH)
        fields = _COMMAND.unpack(datagram)
        if fields[0] != _LEVEL_LOW:
            raise BadPacket(Reason.LEVEL)
        if fields[-1] != checksum(datagram[:604]):
            raise BadPacket(Reason.CRC)
        mode, q, dq, torque, kp, kd = (
            np.array(fields[5 : 5 + 6 * 12]).reshape(12, 6).T[:, self._slot_of]
        )
        if not isfinite(sum(q.tolist()) + sum(dq.tolist())):
            raise BadPacket(Reason.NOT_FINITE)
        sign = self._sign
        return MotorCommand(
            mode.astype(np.uint8), sign * q, sign * dq, sign * torque / _TORQUE, kp / _KP, kd / _KD
        )

    def encode_state(self, state: RobotState) -> bytes:
        """Integer fields saturate. Raises ValueError if anything is not finite."""
        fields = [_LEVEL_LOW, 0, 0, 0, 0]
        for measured in (state.quaternion, state.gyro, state.accelerometer, state.rpy):
            fields += measured.tolist()
        fields.append(0)
        mode, temperature = state.mode.tolist(), state.temperature.tolist()
        q, dq, torque = state.q.tolist(), state.dq.tolist(), (state.tau * _TORQUE).tolist()
        try:
            for joint, sign in self._slots:
                counts = min(max(int(sign * torque[joint]), -32768), 32767)
                fields += mode[joint], sign * q[joint], sign * dq[joint], 0, counts
                fields += 0, 0, 0, temperature[joint]
            if not isfinite(sum(fields)):
                raise ValueError
            fields += state.foot_force.tolist()
            fields += 0, 0, 0, 0, state.tick & 0xFFFFFFFF, state.remote, 0
            return sealed(_STATE.pack(*fields))
        except (OverflowError, ValueError):  # beyond 32 bits, or no number
            raise ValueError("a packet carries finite numbers only") from None


def sealed(packet: bytes) -> bytes:
    """The same with its checksum. It covers whole words: a state's last three bytes are free."""
    body = packet[:-4]
    return body + checksum(body[: len(body) // 4 * 4]).to_bytes(4, "little")


def with_clock_of(state: bytes, other: bytes) -> bytes:
    """``state`` with the clock of another state."""
    clock = slice(_TICK, _TICK + 4)
    return sealed(state[: clock.start] + other[clock] + state[clock.stop :])


def with_angle(state: bytes, joint: str, angle: float) -> bytes:
    """``state`` with another angle [rad] of a joint, one that is no number too."""
    packet = bytearray(state)
    struct.pack_into("<f", packet, _FIRST_Q + _MOTOR_SIZE * MOTORS.index(joint), angle)
    return sealed(bytes(packet))


def checksum(data: bytes) -> int:
    """Of at most 191 whole words: what an STM32's CRC unit makes of them after its reset.

    The remainder by 0x04C11DB7 of the words, little-endian, highest bit first, the first of them
    inverted (for the register begins with ones). A remainder is a sum: of what each byte adds, by
    its value and how many bytes come after it.
    """
    words = np.frombuffer(data, "<u4").astype(">u4")
    words[:1] ^= 0xFFFFFFFF
    entries = _ROWS[-len(data) :] + words.view(np.uint8)
    return int(np.bitwise_xor.reduce(_REMAINDERS.take(entries)))


def _remainders(places: int) -> np.ndarray:
    """(places, 256) of a byte's value with 0, 1, 2, ... bytes after it."""
    table = np.empty((places, 256), np.uint32)
    table[0] = np.arange(256) << 24
    for _ in range(8):
        carry = table[0] >> 31
        table[0] = table[0] << 1 ^ carry * np.uint32(0x04C11DB7)
    for place in range(1, places):
        before = table[place - 1]
        table[place] = before << 8 ^ table[0][before >> 24]
    return table


_REMAINDERS = _remainders(764).ravel()
_ROWS = 256 * np.arange(764)[::-1]
"""Where a byte's row begins, by how many bytes follow it: the last one's is 0"""
