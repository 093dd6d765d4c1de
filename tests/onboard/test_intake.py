"""Which datagrams are believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_onboard import a1_wire
from rmll_onboard.a1_wire import LOW_STATE_LENGTH, Reason, RobotState
from rmll_onboard.intake import Intake
from rmll_onboard.settings import Link

MS = 1_000_000


def state(tick: int, **measured) -> bytes:
    return a1_wire.encode_state(RobotState(tick=tick, **measured))


def flipped(datagram: bytes, bit: int) -> bytes:
    return (int.from_bytes(datagram, "little") ^ 1 << bit).to_bytes(len(datagram), "little")


@pytest.fixture
def intake() -> Intake:
    """Has heard tick 1000 at 1000 ms."""
    intake = Intake(Link())
    assert intake.take(1000 * MS, [state(1000)], resting=False)
    return intake


def test_the_newest_tick_is_taken_whatever_the_order_of_arrival(intake):
    batch = [state(tick) for tick in (1002, 1006, 1004)]
    assert intake.take(1006 * MS, batch, resting=False)
    assert (intake.state.tick, intake.received, intake.rejected) == (1006, 2, 0)


def test_a_good_one_is_found_among_broken_ones(intake):
    good = state(1002)
    hostile = [good[:-1], b"", bytes(LOW_STATE_LENGTH), flipped(good, 200)]
    assert intake.take(1002 * MS, [*hostile, good, *hostile], resting=False)
    assert intake.state.tick == 1002
    assert not intake.only_broken
    assert not intake.take(1003 * MS, hostile, resting=False)
    assert intake.only_broken
    assert intake.refused[Reason.LENGTH] >= 2
    assert intake.refused[Reason.LEVEL] >= 1
    assert intake.refused[Reason.CRC] >= 1


@pytest.mark.parametrize(
    ("tick", "reason"),
    [
        (1000, Reason.REPEATED),
        (999, Reason.LATE),
        (0, Reason.LATE),
        (2**32 - 1, Reason.LATE),
        (1000 + 2**31, Reason.LATE),
        (2100, Reason.AHEAD),
        (2**31, Reason.AHEAD),
    ],
)
def test_a_whole_datagram_of_another_time_is_refused(intake, tick, reason):
    for _ in range(100):
        assert not intake.take(1005 * MS, [state(tick)], resting=False)
    assert intake.refused == {reason: 100}
    assert not intake.only_broken
    assert intake.take(1005 * MS, [state(1005)], resting=False)


def test_the_clock_wraps():
    intake = Intake(Link())
    ticks = [2**32 - 4, 2**32 - 2, 0, 2, 4]
    for count, tick in enumerate(ticks):
        assert intake.take(2 * count * MS, [state(tick)], resting=False)
    assert intake.received == len(ticks)


def test_a_clock_in_microseconds_needs_to_be_told():
    for unit, believed in ((1000, 1), (1, 5)):
        intake = Intake(Link(tick_us=unit))
        for count in range(5):
            intake.take(count * 2 * MS, [state(count * 2000)], resting=False)
        assert intake.received == believed


def test_a_board_that_starts_again_is_believed_only_at_rest(intake):
    reborn = [state(tick) for tick in (5, 10, 15)]
    assert not intake.take(1500 * MS, reborn[:1], resting=False)
    assert not intake.take(1100 * MS, reborn[:1], resting=True)  # it was heard just now
    assert intake.take(1500 * MS, reborn[1:2], resting=True)
    assert intake.take(1505 * MS, reborn[2:], resting=True)
    assert intake.state.tick == 15


def test_a_robot_whose_clock_runs_and_whose_measurements_do_not(intake):
    still = np.full(12, 0.1)
    for ms in range(1010, 1100, 10):
        assert intake.take(ms * MS, [state(ms, q=still)], resting=False)
    assert intake.heard == 1090 * MS
    assert intake.changed == 1010 * MS
    assert intake.take(1100 * MS, [state(1100, q=still + 1e-6)], resting=False)
    assert intake.changed == 1100 * MS


whole = st.integers(0, 2**32 - 1).map(state)
broken = st.binary(max_size=900) | st.tuples(whole, st.integers(0, 763 * 8 + 7)).map(
    lambda pair: flipped(*pair)
)


@given(st.lists(whole | broken, max_size=6), st.integers(0, 10**12))
def test_nothing_but_whole_states_in_their_time_gets_through(batch, later):
    intake = Intake(Link())
    intake.take(0, [state(7)], resting=False)
    fresh = intake.take(later, batch, resting=False)
    ahead = intake.state.tick - 7
    assert fresh == (ahead > 0)
    assert 0 <= ahead <= later // MS + 1000
    if fresh:
        assert state(intake.state.tick) in batch
