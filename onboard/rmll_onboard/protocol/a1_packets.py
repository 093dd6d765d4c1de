"""The datagrams of the Unitree A1's low-level board: LowCmd to the robot, LowState from it.

Layout, scales and checksum as Unitree's own A1 library (unitree_legged_sdk v3.2 to 3.3.4) was
observed to write and read them on loopback. Little-endian, packed, one packet a datagram, no
encryption. Pure; the runtime's directions only. The emulated robot has a codec of its own.

Joint arrays are (12,): legs FR, FL, RR, RL, within a leg hip, thigh, calf.
"""

import zlib
from array import array
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.protocol.a1_remote import decode as decode_remote
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import (
    JOINTS,
    MODE_SERVO,
    POS_STOP,
    VEL_STOP,
    MotorCommand,
    RobotState,
)

LOW_LEVEL = 0xFF
"""Level flag of packets that talk about motors, and not about walking"""
SLOTS = 20

MOTOR_COMMAND = np.dtype(
    [
        ("mode", "u1"),
        ("q", "<f4"),
        ("dq", "<f4"),
        ("tau", "<i2"),
        ("kp", "<i2"),
        ("kd", "<i2"),
        ("reserve", "<u4", 3),
    ]
)
HEADER = [
    ("level", "u1"),
    ("version", "<u2"),
    ("robot_id", "<u2"),
    ("serial", "<u4"),
    ("bandwidth", "u1"),
]
LOW_CMD = np.dtype(
    [
        *HEADER,
        ("motor", MOTOR_COMMAND, SLOTS),
        ("led", "u1", 12),
        ("remote", "u1", 40),
        ("reserve", "<u4"),
        ("crc", "<u4"),
    ]
)
MOTOR_STATE = np.dtype(
    [
        ("mode", "u1"),
        ("q", "<f4"),
        ("dq", "<f4"),
        ("ddq", "<i2"),
        ("tau", "<i2"),
        ("q_raw", "<f4"),
        ("dq_raw", "<f4"),
        ("ddq_raw", "<i2"),
        ("temperature", "i1"),
        ("reserve", "<u4", 2),
    ]
)
LOW_STATE = np.dtype(
    [
        *HEADER,
        ("quaternion", "<f4", 4),
        ("gyroscope", "<f4", 3),
        ("accelerometer", "<f4", 3),
        ("rpy", "<f4", 3),
        ("imu_temperature", "i1"),
        ("motor", MOTOR_STATE, SLOTS),
        ("foot_force", "<i2", 4),
        ("foot_force_estimate", "<i2", 4),
        ("tick", "<u4"),
        ("remote", "u1", 40),
        ("reserve", "<u4"),
        ("crc", "<u4"),
    ]
)
LOW_CMD_LENGTH = LOW_CMD.itemsize
"""610 bytes"""
LOW_STATE_LENGTH = LOW_STATE.itemsize
"""771 bytes"""

# Counts of the int16 fields per N·m, N·m/rad and N·m·s/rad
TAU_SCALE, KP_SCALE, KD_SCALE = 256.0, 32.0, 16.0
_COMMAND_SCALES = np.array([[TAU_SCALE], [KP_SCALE], [KD_SCALE]])


class CommandEncoder:
    """Encodes LowCmds one after the other, in one packet: new arrays would take as long again."""

    def __init__(self, level: int = LOW_LEVEL) -> None:
        self._packet = bytearray(_IDLE_COMMAND)
        self._packet[0] = level
        motor = np.frombuffer(self._packet, LOW_CMD)["motor"][0, :JOINTS]
        self._mode = motor["mode"]
        self._targets = motor["q"], motor["dq"]
        self._counts = motor["tau"], motor["kp"], motor["kd"]
        self._numbers = np.zeros((5, JOINTS))
        self._sizes = np.zeros((5, JOINTS))

    def encode(self, command: MotorCommand) -> bytes:
        """LowCmd, see :func:`encode_command`."""
        numbers, targets = self._numbers, self._numbers[:2]
        numbers[0], numbers[1], numbers[2] = command.q, command.dq, command.tau
        numbers[3], numbers[4] = command.kp, command.kd
        # also false for what would round to infinity in 32 bits, and for NaN, the largest of all
        if not np.abs(numbers, out=self._sizes).max() <= _FLOAT32_MAX:
            raise ValueError(_NOT_FINITE)
        self._mode[:] = command.mode
        for field_, values in zip(self._targets, targets, strict=True):
            field_[:] = values
        for field_, counts in zip(
            self._counts, _saturated(numbers[2:] * _COMMAND_SCALES), strict=True
        ):
            field_[:] = counts
        return _sealed(bytes(self._packet))


def encode_command(command: MotorCommand, level: int = LOW_LEVEL) -> bytes:
    """LowCmd. The unused slots 12 to 19 are left idle, as the SDK leaves them.

    Torque and gains beyond what the wire can carry saturate; they would wrap in the SDK.
    Raises ValueError if anything is not finite.
    """
    return CommandEncoder(level).encode(command)


class StateDecoder:
    """Decodes LowStates one after the other into one state, by one packet: new arrays would take
    as long again."""

    def __init__(self) -> None:
        self.state = RobotState()
        """The last good one; its arrays stay the same ones"""
        self._packet = bytearray(LOW_STATE_LENGTH)
        packet = np.frombuffer(self._packet, LOW_STATE)
        motor = packet["motor"][0, :JOINTS]
        # one after the other in the packet
        imu = np.frombuffer(self._packet, "<f4", _IMU_SIZE, _IMU_OFFSET)
        self._tau, self._tick, self._remote = motor["tau"], packet["tick"], packet["remote"]
        self._numbers = motor["q"], motor["dq"], imu
        state = self.state
        self._copies = (
            (state.q, motor["q"]),
            (state.dq, motor["dq"]),
            (state.quaternion, imu[:4]),
            (state.gyro, imu[4:7]),
            (state.accelerometer, imu[7:10]),
            (state.rpy, imu[10:]),
            (state.mode, motor["mode"]),
            (state.temperature, motor["temperature"]),
            (state.foot_force, packet["foot_force"][0]),
        )

    def decode(self, datagram: bytes) -> None:
        """Into :attr:`state`, which a bad packet does not touch; raises BadPacket."""
        _check(datagram, LOW_STATE_LENGTH)
        self._packet[:] = datagram
        # 64 bits hold the sum of any such numbers; infinity and NaN stay in it
        if not isfinite(sum(sum(numbers.tolist()) for numbers in self._numbers)):
            raise BadPacket(Reason.NOT_FINITE)
        state = self.state
        state.remote = _sane_remote(self._remote.tobytes())
        state.tick = int(self._tick[0])
        np.divide(self._tau, TAU_SCALE, out=state.tau)
        for kept, came in self._copies:
            kept[:] = came


def decode_state(datagram: bytes) -> RobotState:
    """What a LowState tells; raises BadPacket."""
    decoder = StateDecoder()
    decoder.decode(datagram)
    return decoder.state


def check_state(datagram: bytes) -> None:
    """Raises BadPacket unless the datagram is a whole LowState; its numbers are not looked at."""
    _check(datagram, LOW_STATE_LENGTH)


def peek_tick(datagram: bytes) -> int:
    """The tick of a LowState that is not checked yet; too short a one gives 0."""
    return int.from_bytes(datagram[_TICK], "little")


def crc(data: bytes) -> int:
    """The board's checksum of whole 32-bit words: the STM32's CRC unit as it comes.

    Polynomial 0x04C11DB7 from 0xFFFFFFFF over little-endian words, most significant bit first,
    nothing reflected. zlib computes the reflected kind, so its input bytes and its result are
    mirrored: 400 times faster than shifting bits in Python.
    """
    words = array("I", data)
    words.byteswap()
    mirrored = zlib.crc32(words.tobytes().translate(_MIRROR)) ^ 0xFFFFFFFF
    return int.from_bytes(mirrored.to_bytes(4, "little").translate(_MIRROR), "big")


def protected(length: int) -> int:
    """How many leading bytes of a packet its checksum covers; the last odd bytes are left out."""
    return (length // 4 - 1) * 4


_TICK = slice(719, 723)
_IMU_SIZE, _IMU_OFFSET = 13, np.dtype(HEADER).itemsize
"""In a state the IMU comes next"""
_MIRROR = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def _idle_command() -> bytes:
    packet = np.zeros((), LOW_CMD)
    packet["motor"]["mode"] = MODE_SERVO
    packet["motor"]["q"] = POS_STOP
    packet["motor"]["dq"] = VEL_STOP
    return packet.tobytes()


_IDLE_COMMAND = _idle_command()


def _sealed(packet: bytes) -> bytes:
    body = packet[:-4]
    return body + crc(body[: protected(len(packet))]).to_bytes(4, "little")


def _check(datagram: bytes, length: int) -> None:
    """Raises BadPacket unless the datagram is a whole packet of that kind."""
    if len(datagram) != length:
        raise BadPacket(Reason.LENGTH)
    if datagram[0] != LOW_LEVEL:
        raise BadPacket(Reason.LEVEL)
    if crc(datagram[: protected(length)]) != int.from_bytes(datagram[-4:], "little"):
        raise BadPacket(Reason.CRC)


def _saturated(counts: NDArray) -> NDArray:
    # the cast to int16 that follows truncates towards zero, as the SDK does
    return np.minimum(np.maximum(counts, -32768), 32767)


def _sane_remote(data: bytes) -> bytes:
    """The same. The daemon asks for the same bytes' meaning next, so looking costs nothing."""
    try:
        decode_remote(data)
    except ValueError:
        raise BadPacket(Reason.NOT_FINITE) from None
    return data


_NOT_FINITE = "a packet carries finite numbers only"
_FLOAT32_MAX = float(np.finfo(np.float32).max)
