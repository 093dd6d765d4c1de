"""The wireless remote's forty bytes."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_hil.robot.a1_joystick import press
from rmll_onboard.protocol import a1_remote
from rmll_onboard.protocol.a1_remote import Button, Remote

sticks = st.floats(-1, 1, width=32)


def sent(pressed: Remote) -> bytes:
    """By the board, whose buttons have names of its own."""
    held = [button.name for button in Button if button in pressed.buttons and button.name]
    return press(*held, lx=pressed.lx, ly=pressed.ly, rx=pressed.rx, ry=pressed.ry)


@given(
    st.builds(
        Remote,
        buttons=st.integers(0, 0xFFFF).map(Button),
        lx=sticks,
        ly=sticks,
        rx=sticks,
        ry=sticks,
    )
)
def test_round_trip(pressed):
    data = sent(pressed)
    assert len(data) == a1_remote.LENGTH
    assert a1_remote.decode(data) == pressed


@pytest.mark.fuzz
@given(st.binary(min_size=40, max_size=40))
def test_any_bytes_give_sticks_within_their_range_or_are_refused(data):
    sticks = [struct.unpack_from("<f", data, offset)[0] for offset in (4, 8, 12, 20)]
    if not all(map(math.isfinite, sticks)):
        with pytest.raises(ValueError, match="a stick of the remote is"):
            a1_remote.decode(data)
        return
    pressed = a1_remote.decode(data)
    for stick in (pressed.lx, pressed.ly, pressed.rx, pressed.ry, pressed.forward, pressed.turn):
        assert -1 <= stick <= 1


@given(st.integers(0, 15), st.sampled_from([math.nan, math.inf, -math.inf]))
def test_what_is_not_used_may_be_anything(place, value):
    data = bytearray(press(ly=0.5))
    struct.pack_into("<f", data, 16, value)
    data[24 + place] = 0xFF
    assert a1_remote.decode(bytes(data)) == Remote(ly=0.5)


@given(st.floats(-1, 1), st.floats(0, 0.5))
def test_beyond_the_deadband_a_stick_still_reaches_everything(stick, deadband):
    way = a1_remote.past(stick, deadband)
    assert abs(way) <= abs(stick) + 1e-12
    assert (way != 0) <= (abs(stick) > deadband)
    assert a1_remote.past(-stick, deadband) == -way
    assert a1_remote.past(stick / 2, deadband) <= way or stick < 0
    assert (a1_remote.past(1.0, deadband), a1_remote.past(-1.0, deadband)) == (1.0, -1.0)
    # no jump at its edge
    assert a1_remote.past(deadband + 1e-6, deadband) == pytest.approx(0, abs=1e-5)


@given(st.floats(0, 0.5), sticks)
def test_held_is_a_button_or_a_stick_beyond_the_deadband(deadband, stick):
    for name in ("lx", "ly", "rx", "ry"):
        assert Remote(**{name: stick}).held(deadband) == (abs(stick) > deadband)
    assert Remote(Button.F1).held(deadband)
    assert not Remote(lx=-0.0, ly=-0.0).held(0.0)


def test_fields_lie_where_the_sdk_puts_them():
    data = bytearray(40)
    struct.pack_into("<H", data, 2, 1 << 2 | 1 << 8)
    for offset, value in ((4, 0.1), (8, 0.2), (12, 0.3), (20, 0.4)):
        struct.pack_into("<f", data, offset, value)
    pressed = a1_remote.decode(bytes(data))
    assert pressed.buttons == Button.START | Button.A
    assert (pressed.lx, pressed.rx, pressed.ry, pressed.ly) == pytest.approx((0.1, 0.2, 0.3, 0.4))


def test_l2_is_sent_as_an_analog_key_too():
    for buttons, value in ((Button.L2 | Button.A, 1.0), (Button.B, 0.0)):
        assert struct.unpack_from("<f", sent(Remote(buttons)), 16) == (value,)


def test_a_stick_that_is_no_number_is_told():
    with pytest.raises(ValueError, match=r"^a stick of the remote is nan$"):
        a1_remote.decode(struct.pack("<2xH5f16x", 0, 0, math.nan, 0, 0, 0))


def test_left_stick_up_is_forward_and_right_stick_left_turns_left():
    pressed = Remote(ly=0.5, rx=-0.25)
    assert pressed.forward == 0.5
    assert pressed.turn == 0.25


@pytest.mark.parametrize("buttons", [Button.L2, Button.B, Button.L2 | Button.A])
def test_only_l2_and_b_together_stop(buttons):
    assert not Remote(buttons).emergency_stop
    assert Remote(buttons | Button.L2 | Button.B).emergency_stop


@pytest.mark.parametrize(("pushed", "read"), [(1.5, 1.0), (-1.5, -1.0), (1.0, 1.0), (-1.0, -1.0)])
def test_a_stick_beyond_its_end_is_at_its_end(pushed: float, read: float) -> None:
    decoded = a1_remote.decode(press(lx=pushed, ly=pushed, rx=pushed, ry=pushed))
    assert (decoded.lx, decoded.ly, decoded.rx, decoded.ry) == (read,) * 4
