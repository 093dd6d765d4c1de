"""Frames packed into a datagram, and the IMU's own frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rmll_hil.robot import robot_frames
from rmll_onboard.protocol import can_imu
from rmll_onboard.protocol.can_frame import MOST, Frame, pack, unpack
from rmll_onboard.state.packet_errors import BadPacket
from rmll_onboard.state.robot_state import RobotState

frames = st.lists(
    st.builds(Frame, st.integers(0, 255), st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=30
)


@given(frames)
def test_frames_come_back_and_the_robot_reads_and_writes_the_same(sent):
    assert list(unpack(pack(sent))) == sent
    assert robot_frames.split(pack(sent)) == sent
    assert list(unpack(robot_frames.join(sent))) == sent


def test_a_frame_of_known_bytes():
    """Identifier 0x123 on bus 2, three bytes."""
    datagram = bytes.fromhex("2301 02 03 aabbcc0000000000")
    assert pack([Frame(2, 0x123, b"\xaa\xbb\xcc")]) == datagram
    assert list(unpack(datagram)) == [(2, 0x123, b"\xaa\xbb\xcc")]


@pytest.mark.fuzz
@given(st.binary(max_size=200))
def test_any_bytes_are_frames_or_refused(datagram):
    try:
        found = list(unpack(datagram))
    except BadPacket:
        with pytest.raises(BadPacket):
            robot_frames.split(datagram)
        return
    assert robot_frames.split(datagram) == found
    assert len(found) * 12 == len(datagram)
    assert all(len(frame.data) <= 8 and frame.id <= 0x7FF for frame in found)


def test_too_many_frames_are_refused():
    unpack(bytes(12 * MOST))
    with pytest.raises(BadPacket):
        unpack(bytes(12 * (MOST + 1)))


def units(size):
    return hnp.arrays(np.float64, size, elements=st.floats(-1, 1))


def sample(quaternion, gyro, milliseconds):
    return robot_frames.imu_sample(RobotState(quaternion=quaternion, gyro=gyro, tick=milliseconds))


@given(units(4), units(3), st.integers(0, 10**9))
def test_an_imus_sample_comes_back(quaternion, rate, milliseconds):
    gyro = 36 * rate
    orientation, turning = sample(quaternion, gyro, milliseconds)
    assert len(orientation) == len(turning) == can_imu.LENGTH
    ours, theirs, clock = can_imu.decode(orientation, turning)
    np.testing.assert_allclose(ours, quaternion, atol=0.51 / 32767)
    np.testing.assert_allclose(theirs, gyro, atol=0.51 / 900)
    assert clock == milliseconds % 65536


def test_an_imus_sample_of_known_bytes_and_one_beyond_the_range():
    frames = sample(np.array([1.0, 0, 0, -1.0]), np.array([1.0, -1.0, 99.0]), 258)
    assert [data.hex() for data in frames] == ["7fff000000008001", "0384fc7c7fff0102"]
