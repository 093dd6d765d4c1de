"""Commands on their way to the policy."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_gaits.table import Commands
from rmll_onboard.control.command_limiter import CommandRateLimiter
from rmll_onboard.settings.runtime_settings import Steering

TRAINED = Commands(vx=(-0.5, 1.0), wz=(-1.0, 1.0), frequency=(6.0, 12.0))
STEERING = Steering(acceleration=2.0, turning=4.0, frequency=5.0)
RATES = 2.0, 4.0, 5.0
LIMITS = (-0.5, 1.0), (-1.0, 1.0), (6.0, 12.0)

anything = st.tuples(*[st.floats() | st.floats(-20, 20)] * 3)


@given(st.lists(anything, min_size=1, max_size=30))
def test_no_wish_leaves_what_was_trained_or_changes_faster_than_allowed(wishes):
    limiter = CommandRateLimiter(TRAINED, STEERING, 50)
    limiter.reset(wishes[0])
    before = limiter.step(wishes[0])
    for wish in wishes:
        now = limiter.step(wish)
        for value, last, rate, (low, high) in zip(now, before, RATES, LIMITS, strict=True):
            assert low <= value <= high
            assert abs(value - last) <= rate / 50 + 1e-12
        before = now


def test_a_walk_starts_from_rest_and_gets_where_it_is_wanted_in_the_time_it_takes():
    limiter = CommandRateLimiter(TRAINED, STEERING, 50)
    limiter.reset((1.0, -1.0, 7.0))
    steps = [limiter.step((1.0, -1.0, 7.0)) for _ in range(25)]
    assert steps[0] == pytest.approx((0.04, -0.08, 7.0))
    assert steps[11] == pytest.approx((0.48, -0.96, 7.0))
    assert steps[-1] == (1.0, -1.0, 7.0)
    assert limiter.step((5.0, 0.0, 12.0)) == pytest.approx((1.0, -0.92, 7.1))


def test_a_limit_is_left_as_soon_as_the_wish_turns_back():
    limiter = CommandRateLimiter(TRAINED, STEERING, 50)
    limiter.reset((0.0, 0.0, 9.0))
    for _ in range(100):
        limiter.step((50.0, 0.0, 9.0))
    assert limiter.step((0.0, 0.0, 9.0))[0] == pytest.approx(0.96)
