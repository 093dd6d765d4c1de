"""The A1's datagrams, against golden bytes of the SDK and the emulated board's own codec."""

import dataclasses
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rmll_hil.robot.a1_board_packets import A1BoardPackets, checksum, sealed
from rmll_onboard.protocol import a1_packets
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MotorCommand, RobotState

BOARD = A1BoardPackets()


def single(size, bound=None):
    """Arrays of numbers that 32 bits carry exactly."""
    return hnp.arrays(
        np.float64,
        size,
        elements=st.floats(
            None if bound is None else -bound,
            bound,
            width=32,
            allow_nan=False,
            allow_infinity=False,
        ),
    )


def counts(size, scale):
    """Arrays of whole multiples of 1/scale within int16."""
    return hnp.arrays(np.int16, size).map(lambda array: array / scale)


bytes12 = hnp.arrays(np.uint8, 12)
commands = st.builds(
    MotorCommand,
    mode=bytes12,
    q=single(12),
    dq=single(12),
    tau=counts(12, 256),
    kp=counts(12, 32),
    kd=counts(12, 16),
)
states = st.builds(
    RobotState,
    mode=bytes12,
    q=single(12),
    dq=single(12),
    tau=counts(12, 256),
    temperature=hnp.arrays(np.int8, 12),
    quaternion=single(4),
    gyro=single(3),
    accelerometer=single(3),
    rpy=single(3),
    foot_force=hnp.arrays(np.int16, 4),
    tick=st.integers(0, 2**32 - 1),
    remote=st.builds(
        lambda head, sticks, idle: head + struct.pack("<5f", *sticks) + idle,
        st.binary(min_size=4, max_size=4),
        st.lists(st.floats(-3, 3, width=32), min_size=5, max_size=5),
        st.binary(min_size=16, max_size=16),
    ),
)


def assert_same(a, b):
    for field in dataclasses.fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), field.name)


def test_command_as_the_sdk_initialises_it():
    idle = MotorCommand(
        mode=np.full(12, a1_packets.MODE_SERVO, np.uint8),
        q=np.full(12, a1_packets.POS_STOP),
        dq=np.full(12, a1_packets.VEL_STOP),
    )
    slot = bytes.fromhex("0ab9d2ff4e00007a46") + bytes(18)
    golden = bytes(10) + 20 * slot + bytes(56) + struct.pack("<I", 0x77DB73E3)
    assert a1_packets.encode_command(idle, level=0) == golden
    assert len(golden) == a1_packets.LOW_CMD_LENGTH == 610
    with pytest.raises(BadPacket) as bad:
        BOARD.decode_command(golden)
    assert bad.value.reason is Reason.LEVEL


def test_motor_slot_as_the_sdk_writes_it():
    command = MotorCommand()
    for name, value in {"q": 0.25, "dq": -0.5, "tau": -10.3, "kp": 20.0, "kd": 0.5}.items():
        getattr(command, name)[0] = value
    golden = bytes.fromhex("000000803e000000bfb4f580020800" + "000000a0000000b0000000c0")
    assert a1_packets.encode_command(command)[10 : 10 + 15] == golden[:15]
    slot = np.frombuffer(golden, a1_packets.MOTOR_COMMAND)[0]
    assert slot["reserve"].tolist() == [0xA0000000, 0xB0000000, 0xC0000000]


def test_state_fields_lie_where_the_board_puts_them():
    offsets = {name: a1_packets.LOW_STATE.fields[name][1] for name in a1_packets.LOW_STATE.names}
    assert a1_packets.LOW_STATE_LENGTH == 771
    assert (offsets["quaternion"], offsets["imu_temperature"], offsets["motor"]) == (10, 62, 63)
    assert (offsets["foot_force"], offsets["tick"], offsets["remote"]) == (703, 719, 723)
    assert a1_packets.MOTOR_STATE.itemsize == 32
    assert a1_packets.MOTOR_STATE.fields["temperature"][1] == 23


@given(commands)
def test_the_board_reads_the_command_that_was_meant(command):
    assert_same(BOARD.decode_command(a1_packets.encode_command(command)), command)


@given(states, states)
def test_a_state_is_read_as_the_board_measured_it_whatever_came_before(state, used):
    decoder = a1_packets.StateDecoder()
    for sent in (used, state):
        decoder.decode(BOARD.encode_state(sent))
        assert_same(decoder.state, sent)


@given(commands, commands)
def test_a_used_encoder_keeps_nothing_of_the_command_before(command, used):
    encoder = a1_packets.CommandEncoder()
    encoder.encode(used)
    assert encoder.encode(command) == a1_packets.encode_command(command)


@given(single(12), single(12), single(12))
def test_torque_and_gains_saturate(tau, kp, kd):
    sent = MotorCommand(tau=tau, kp=kp, kd=kd)
    got = BOARD.decode_command(a1_packets.encode_command(sent))
    for name, scale in (("tau", 256), ("kp", 32), ("kd", 16)):
        low, high = -32768 / scale, 32767 / scale
        want = np.clip(getattr(sent, name), low, high)
        assert (np.abs(getattr(got, name)) <= np.abs(want)).all()
        np.testing.assert_allclose(getattr(got, name), want, rtol=0, atol=1 / scale)


def test_what_wraps_in_the_sdk_saturates_here():
    got = BOARD.decode_command(
        a1_packets.encode_command(MotorCommand(tau=np.full(12, 200.0), kd=np.full(12, 3000.0)))
    )
    assert got.tau[0] == 32767 / 256
    assert got.kd[0] == 32767 / 16


@pytest.mark.parametrize(
    ("packet", "decode"),
    [
        (a1_packets.encode_command(MotorCommand()), BOARD.decode_command),
        (BOARD.encode_state(RobotState()), a1_packets.decode_state),
    ],
    ids=["command", "state"],
)
def test_every_flipped_protected_bit_is_refused(packet, decode):
    covered = a1_packets.protected(len(packet))
    assert covered == {610: 604, 771: 764}[len(packet)]
    for position in [*range(covered), *range(len(packet) - 4, len(packet))]:
        for bit in range(8):
            broken = bytearray(packet)
            broken[position] ^= 1 << bit
            with pytest.raises(BadPacket) as bad:
                decode(bytes(broken))
            assert bad.value.reason is (Reason.LEVEL if position == 0 else Reason.CRC)


@pytest.mark.fuzz
@given(st.binary(max_size=1000))
def test_random_bytes_are_refused(data):
    for decode in (BOARD.decode_command, a1_packets.decode_state):
        with pytest.raises(BadPacket):
            decode(data)


def with_checksum(packet, offset, value):
    packet = bytearray(packet)
    struct.pack_into("<f", packet, offset, value)
    return sealed(bytes(packet))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("offset", [10, 26, 38, 50, 64, 68], ids=str)
def test_a_state_that_is_not_finite_is_refused_and_leaves_the_last_one(offset, value):
    packet = with_checksum(BOARD.encode_state(RobotState()), offset, value)
    decoder = a1_packets.StateDecoder()
    decoder.decode(BOARD.encode_state(RobotState(tick=7)))
    with pytest.raises(BadPacket) as bad:
        decoder.decode(packet)
    assert bad.value.reason is Reason.NOT_FINITE
    assert_same(decoder.state, RobotState(tick=7))


@pytest.mark.parametrize("value", [3.4e38, -3.4e38])
def test_large_numbers_are_finite(value):
    """Their sum would not be, in 32 bits."""
    state = RobotState(q=np.full(12, np.float32(value), float), dq=np.full(12, value))
    np.testing.assert_array_equal(a1_packets.decode_state(BOARD.encode_state(state)).q, state.q)


@pytest.mark.parametrize("name", ["q", "dq", "tau", "quaternion", "gyro", "accelerometer", "rpy"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_the_board_never_sends_what_is_not_finite(name, value):
    state = RobotState()
    getattr(state, name)[-1] = value
    with pytest.raises(ValueError, match="finite"):
        BOARD.encode_state(state)
    with pytest.raises(ValueError, match="finite"):
        BOARD.encode_state(RobotState(q=np.full(12, 1e39)))


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("offset", [11, 15, 11 + 27 * 11, 15 + 27 * 11])
def test_the_board_drops_a_command_that_is_not_finite(offset, value):
    packet = with_checksum(a1_packets.encode_command(MotorCommand()), offset, value)
    with pytest.raises(BadPacket) as bad:
        BOARD.decode_command(packet)
    assert bad.value.reason is Reason.NOT_FINITE


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e39])
@pytest.mark.parametrize("name", ["q", "dq", "tau", "kp", "kd"])
def test_a_command_that_is_not_finite_is_never_encoded(name, value):
    command = MotorCommand()
    getattr(command, name)[5] = value
    with pytest.raises(ValueError, match="finite"):
        a1_packets.encode_command(command)


@settings(max_examples=30)
@given(st.binary(min_size=4, max_size=64).filter(lambda data: len(data) % 4 == 0))
def test_checksum_equals_the_shift_register(data):
    register = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", data):
        register ^= word
        for _ in range(32):
            register = (register << 1 ^ (0x04C11DB7 if register >> 31 else 0)) & 0xFFFFFFFF
    assert a1_packets.crc(data) == register
    assert checksum(data) == register
