"""Which datagrams are believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.interface.a1_interface import A1Interface
from rmll_onboard.protocol.a1_packets import LOW_STATE_LENGTH
from rmll_onboard.settings.runtime_settings import LinkSettings
from rmll_onboard.state.packet_errors import Reason
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import A1

BOARD = A1BoardPackets()
MS = 1_000_000


def state(tick: int, **measured) -> bytes:
    return BOARD.encode_state(RobotState(tick=tick, **measured))


def flipped(datagram: bytes, bit: int) -> bytes:
    return (int.from_bytes(datagram, "little") ^ 1 << bit).to_bytes(len(datagram), "little")


@pytest.fixture
def interface() -> A1Interface:
    """Has heard tick 1000 at 1000 ms."""
    interface = A1Interface(LinkSettings(), A1)
    assert interface.take(1000 * MS, [state(1000)], resting=False)
    return interface


def test_the_newest_tick_is_taken_whatever_the_order_of_arrival(interface):
    batch = [state(tick) for tick in (1002, 1006, 1004)]
    assert interface.take(1006 * MS, batch, resting=False)
    assert (interface.state.tick, interface.received, interface.rejected) == (1006, 2, 0)


def test_a_good_one_is_found_among_broken_ones(interface):
    good = state(1002)
    hostile = [good[:-1], b"", bytes(LOW_STATE_LENGTH), flipped(good, 200)]
    assert interface.take(1002 * MS, [*hostile, good, *hostile], resting=False)
    assert interface.state.tick == 1002
    assert not interface.only_broken
    assert not interface.take(1003 * MS, hostile, resting=False)
    assert interface.only_broken
    assert interface.refused[Reason.LENGTH] >= 2
    assert interface.refused[Reason.LEVEL] >= 1
    assert interface.refused[Reason.CRC] >= 1


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
def test_a_whole_datagram_of_another_time_is_refused(interface, tick, reason):
    for _ in range(100):
        assert not interface.take(1005 * MS, [state(tick)], resting=False)
    assert interface.refused == {reason: 100}
    assert not interface.only_broken
    assert interface.take(1005 * MS, [state(1005)], resting=False)


def test_the_clock_wraps():
    interface = A1Interface(LinkSettings(), A1)
    ticks = [2**32 - 4, 2**32 - 2, 0, 2, 4]
    for count, tick in enumerate(ticks):
        assert interface.take(2 * count * MS, [state(tick)], resting=False)
    assert interface.received == len(ticks)


def test_a_clock_in_microseconds_needs_to_be_told():
    for unit, believed in ((1000, 1), (1, 5)):
        interface = A1Interface(LinkSettings(tick_us=unit), A1)
        for count in range(5):
            interface.take(count * 2 * MS, [state(count * 2000)], resting=False)
        assert interface.received == believed


def test_a_board_that_starts_again_is_believed_only_at_rest(interface):
    reborn = [state(tick) for tick in (5, 10, 15)]
    assert not interface.take(1500 * MS, reborn[:1], resting=False)
    assert not interface.take(1100 * MS, reborn[:1], resting=True)  # it was heard just now
    assert interface.take(1500 * MS, reborn[1:2], resting=True)
    assert interface.take(1505 * MS, reborn[2:], resting=True)
    assert interface.state.tick == 15


def test_a_robot_whose_clock_runs_and_whose_measurements_do_not(interface):
    still = np.full(12, 0.1)
    for ms in range(1010, 1100, 10):
        assert interface.take(ms * MS, [state(ms, q=still)], resting=False)
    assert interface.heard == 1090 * MS
    assert interface.changed == 1010 * MS
    assert interface.take(1100 * MS, [state(1100, q=still + 1e-6)], resting=False)
    assert interface.changed == 1100 * MS


def test_what_is_lost_and_heard_is_counted():
    interface = A1Interface(LinkSettings(), A1)
    assert (
        interface.received,
        interface.lost,
        interface.rejected,
        interface.heard,
        interface.changed,
    ) == (0,) * 5
    assert interface.only_broken is False
    assert not interface.take(5 * MS, [], resting=True)
    assert (interface.lost, interface.only_broken) == (0, False)  # nothing can be lost yet
    assert interface.take(10 * MS, [state(7)], resting=True)
    assert (interface.heard, interface.changed, interface.lost) == (10 * MS, 10 * MS, 0)
    for count in range(1, 4):
        assert not interface.take((10 + count) * MS, [], resting=True)
        assert (interface.lost, interface.only_broken) == (count, False)


def test_what_was_refused_is_told(interface):
    assert interface.refusals == "refused: none"
    for datagram in (state(1000), b"", state(1000), state(9000)):
        interface.take(1001 * MS, [datagram], resting=False)
    assert interface.refusals == "refused: 2 repeated, 1 length, 1 ahead of time"
    interface.take(1001 * MS, [state(9000)], resting=False)
    told = "refused: 2 repeated, 1 length, 2 ahead of time; is link.tick_us right?"
    assert interface.refusals == told


def test_a_count_of_the_clock_in_seconds():
    assert A1Interface(LinkSettings(), A1).tick_seconds == pytest.approx(1e-3)
    assert A1Interface(LinkSettings(tick_us=1), A1).tick_seconds == pytest.approx(1e-6)


def test_late_and_repeated_datagrams_are_refused_but_not_rejected(interface):
    broken = flipped(state(1002), 200)
    for datagram in (state(1000), state(999), state(9000), broken, b""):
        assert not interface.take(1001 * MS, [datagram], resting=False)
    assert interface.rejected == 3
    assert interface.refused.total() == 5


@pytest.mark.parametrize("reason", ["repeated", "late", "ahead"])
def test_a_broken_datagram_of_another_time_is_called_broken(interface, reason):
    tick = {"repeated": 1000, "late": 900, "ahead": 90_000}[reason]
    assert not interface.take(1001 * MS, [flipped(state(tick), 300)], resting=False)
    assert interface.refused == {Reason.CRC: 1}
    assert interface.only_broken


def test_one_whole_datagram_is_enough_not_to_be_only_broken(interface):
    for batch in ([b"", state(1000)], [state(1000), b""], [b"", state(1000), b""]):
        assert not interface.take(1001 * MS, batch, resting=False)
        assert not interface.only_broken


@pytest.mark.parametrize(("ahead", "believed"), [(1005, True), (1006, False), (1, True)])
def test_a_clock_may_be_a_second_ahead_of_ours(interface, ahead, believed):
    """5 ms after the last one, to the millisecond."""
    assert interface.take(1005 * MS, [state(1000 + ahead)], resting=False) is believed


@pytest.mark.parametrize(("after", "believed"), [(200 * MS, False), (200 * MS + 1, True)])
def test_a_board_may_start_again_after_a_fifth_of_a_second(interface, after, believed):
    assert interface.take(1000 * MS + after, [state(5)], resting=True) is believed


def test_of_equal_ticks_the_one_that_came_last_is_taken(interface):
    batch = [state(1002, q=np.full(12, value)) for value in (0.1, 0.2)]
    assert interface.take(1002 * MS, batch, resting=False)
    assert interface.state.q[0] == pytest.approx(0.2)


def test_of_the_first_datagrams_the_newest_is_not_known():
    """Without a tick to start from, the one that came last."""
    interface = A1Interface(LinkSettings(), A1)
    assert interface.take(0, [state(50), state(40)], resting=True)
    assert interface.state.tick == 40


whole = st.integers(0, 2**32 - 1).map(state)
broken = st.binary(max_size=900) | st.tuples(whole, st.integers(0, 763 * 8 + 7)).map(
    lambda pair: flipped(*pair)
)


@given(st.lists(whole | broken, max_size=6), st.integers(0, 10**12))
def test_nothing_but_whole_states_in_their_time_gets_through(batch, later):
    interface = A1Interface(LinkSettings(), A1)
    interface.take(0, [state(7)], resting=False)
    fresh = interface.take(later, batch, resting=False)
    ahead = interface.state.tick - 7
    assert fresh == (ahead > 0)
    assert 0 <= ahead <= later // MS + 1000
    if fresh:
        assert state(interface.state.tick) in batch
