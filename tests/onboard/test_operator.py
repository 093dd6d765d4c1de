"""Who leads: the remote's buttons for c_f, and flags with several values of it."""

import pytest

from rmll_common.errors import InputError
from rmll_gaits.table import Commands
from rmll_onboard.commands.operator import FlagOperator, RemoteOperator
from rmll_onboard.protocol.a1_remote import Button, Remote
from rmll_onboard.state.modes import NS, Mode, Request

RANGES = Commands(vx=(-1.0, 1.0), wz=(-1.0, 1.0), frequency=(6.0, 12.0))


def test_up_and_down_change_c_f_once_a_push_and_within_what_was_trained():
    operator = RemoteOperator(RANGES, 7.0, 0.08)

    def push(button: Button) -> float:
        held = [operator.orders(0, Mode.WALKING, Remote(button)).command[2] for _ in range(3)]
        assert len(set(held)) == 1
        operator.orders(0, Mode.WALKING, Remote())
        return held[0]

    assert [push(Button.UP) for _ in range(3)] == [6.0, 6.0, 6.0]
    assert [push(Button.DOWN) for _ in range(7)] == [7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 12.0]
    assert push(Button.UP | Button.DOWN) == 12.0


def test_sticks_count_from_the_deadband_to_the_end():
    def vx_and_wz(ly: float, rx: float):
        operator = RemoteOperator(Commands((-0.5, 1.0), (-1.0, 1.0), (6.0, 12.0)), 7.0, 0.1)
        return operator.orders(0, Mode.WALKING, Remote(ly=ly, rx=rx)).command[:2]

    assert vx_and_wz(0.1, -0.1) == (0, 0)
    assert vx_and_wz(1.0, -1.0) == (1.0, 1.0)
    assert vx_and_wz(-1.0, 1.0) == (-0.5, -1.0)
    assert vx_and_wz(0.55, 0.55) == pytest.approx((0.5, -0.5))


def test_several_values_of_c_f_share_the_seconds():
    operator = FlagOperator(RANGES, 0.5, 0.0, (12, 6, 12), seconds=9.0)
    assert operator.orders(0, Mode.DAMPING, Remote()).command == (0.5, 0.0, 12)

    def at(seconds: float):
        return operator.orders(int((5 + seconds) * NS), Mode.WALKING, Remote())

    told = {seconds: at(seconds).command[2] for seconds in (0, 2.9, 3.1, 5.9, 6.1, 8.9, 9.5)}
    assert told == {0: 12, 2.9: 12, 3.1: 6, 5.9: 6, 6.1: 12, 8.9: 12, 9.5: 12}
    assert at(8.9).request is None
    assert at(9.0).request is Request.SIT


@pytest.mark.parametrize(
    ("frequency", "seconds", "words"),
    [
        ((12, 5), 9.0, "--frequency 5: this gait was trained for 6 to 12"),
        ((12, float("nan")), 9.0, "--frequency nan"),
        ((12, 6), None, "needs --seconds"),
    ],
)
def test_values_that_make_no_walk_are_refused(frequency, seconds, words):
    with pytest.raises(InputError, match=words):
        FlagOperator(RANGES, 0.5, 0.0, frequency, seconds)


def test_one_value_and_none():
    assert FlagOperator(RANGES, frequency=7.0).frequencies == (7.0,)
    assert (
        FlagOperator(RANGES).frequencies == FlagOperator(RANGES, frequency=()).frequencies == (9.0,)
    )
