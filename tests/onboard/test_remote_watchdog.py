"""Is the wireless remote there? Lost is one that does what a resting one cannot."""

import struct
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_hil.robot.a1_joystick import BUTTONS, press
from rmll_onboard.safety.remote_watchdog import RemoteWatchdog
from rmll_onboard.settings.runtime_settings import Safety

DEADBAND = 0.08
NOTHING = bytes(40)
headless = partial(press, head=bytes(2))


@pytest.fixture
def lost():
    watchdog = RemoteWatchdog(Safety(remote_lost_ms=500, remote_still=20), DEADBAND)
    return lambda seconds, data: watchdog.lost(int(seconds * 1e9), data)


@pytest.mark.parametrize("there", [press(), bytes(39) + b"\x07"])
def test_all_zero_although_bytes_that_no_hand_moves_were_not(lost, there):
    assert not lost(0, there)
    assert not lost(100, there)  # nobody touches it
    assert not lost(101, NOTHING)
    assert not lost(101.4, NOTHING)
    assert lost(101.6, NOTHING)
    assert lost(9000, NOTHING)
    assert not lost(9001, there)


def test_a_remote_that_rests_at_zero_is_not_lost_after_it_was_used(lost):
    assert not lost(0, headless("A", "L2", ly=0.5))
    assert not lost(1, NOTHING)
    assert not lost(9000, NOTHING)


@pytest.mark.parametrize("held", [headless(ly=0.7), headless(rx=-0.09), headless("A")])
def test_held_without_a_tremble_for_too_long(lost, held):
    assert not lost(0, held)
    assert not lost(19, held)
    assert lost(21, held)
    assert not lost(22, headless(ly=0.71))


def test_limits_are_exact():
    """To the nanosecond, from the one at which the bytes came."""
    for before, data, limit in (
        (press(), NOTHING, 500_000_000),
        (NOTHING, headless(ly=0.7), 20_000_000_000),
    ):
        watchdog = RemoteWatchdog(Safety(remote_lost_ms=500, remote_still=20), DEADBAND)
        watchdog.lost(0, before)
        assert watchdog.lost(7, data) is False
        assert watchdog.lost(7 + limit, data) is False
        assert watchdog.lost(8 + limit, data) is True


def test_a_remote_that_has_been_zero_from_the_first_is_not_lost(lost):
    assert lost(9000, NOTHING) is False


def test_a_hand_trembles(lost):
    assert not any(lost(second, headless(ly=0.7 + second % 2 * 1e-3)) for second in range(99))


stray = st.floats(-0.0625, 0.0625, width=32)
marks = st.binary(min_size=2, max_size=2), st.binary(min_size=16, max_size=16)
presses = st.lists(
    st.builds(
        lambda held, ly: press(*held, ly=ly),
        st.sets(st.sampled_from(BUTTONS)),
        st.floats(-1, 1, width=32),
    )
)


@pytest.mark.fuzz
@given(*marks, st.tuples(stray, stray, stray, stray, stray), presses)
def test_a_resting_remote_is_never_lost(head, unused, sticks, pressed):
    """Whatever its head, its unused bytes and its sticks are, and whatever was pressed before."""
    watchdog = RemoteWatchdog(Safety(), DEADBAND)
    rest = head + struct.pack("<H5f", 0, *sticks) + unused
    now = 0
    for held in pressed:
        # all but the head and the unused bytes are the hand's
        now += 100_000_000
        assert not watchdog.lost(now, head + held[2:24] + unused)
    for _ in range(20):
        now += 3_600_000_000_000
        assert not watchdog.lost(now, rest)
    assert not watchdog.lost(now, headless() if not any(head + unused) else rest)


@pytest.mark.fuzz
@given(*marks, presses)
def test_all_forty_bytes_zero_are_lost_where_a_resting_remote_shows_more(head, unused, pressed):
    watchdog = RemoteWatchdog(Safety(remote_lost_ms=500), DEADBAND)
    now = 0
    for held in [press(), *pressed]:
        now += 100_000_000
        watchdog.lost(now, head + held[2:24] + unused)
    watchdog.lost(now + 1, NOTHING)
    assert watchdog.lost(now + 600_000_000, NOTHING) == any(head + unused)
