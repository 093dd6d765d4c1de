"""Durations counted, and told as percentiles."""

import mmap

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_onboard.runtime.timing import Durations, Timing, memory_mb, table
from rmll_onboard.state.reports import UpperPercentiles

US, MINUTE = 1000, 60_000_000_000


def counted(durations) -> Durations:
    counter = Durations()
    for duration in durations:
        counter.add(duration)
    return counter


@given(st.lists(st.integers(-(10**6), 60_000 * US), min_size=1, max_size=60))
def test_percentiles_are_those_of_all_durations(durations):
    counter = counted(durations)
    highest, lowest = counter.highest(), counter.lowest()
    microseconds = np.maximum(durations, 0) // US
    for figures, name, share in (
        *((highest, name, share) for name, share in (("p50", 50), ("p99", 99), ("p999", 99.9))),
        *((lowest, name, share) for name, share in (("p01", 1), ("p001", 0.1))),
    ):
        assert getattr(figures, name) == np.percentile(microseconds, share, method="inverted_cdf")
    assert highest.max == pytest.approx(max(durations) / US, abs=0.1)
    assert lowest.min == pytest.approx(min(durations) / US, abs=0.1)


def test_a_stall_is_told_by_the_maximum():
    counter = counted([100 * US] * 99 + [3_000_000 * US])
    assert counter.highest() == UpperPercentiles(100, 100, 65535, 3_000_000)


def test_nothing_counted_is_none():
    timing = Timing()
    report = timing.report()
    assert (report.tick_us, report.wake_us, report.timekeeping.slack_us) == (
        None,
        None,
        None,
    )
    assert "policy tick" not in table(report)


def test_the_table_has_a_row_for_each_kind_of_tick():
    timing = Timing()
    timing.tick.add(200 * US)
    timing.plain_tick.add(90 * US)
    timing.wake.add(7 * US)
    timing.slack.add(-40 * US)
    timing.missed = 3
    rows = [line.split() for line in table(timing.report()).splitlines()]
    assert rows[:-1] == [
        ["[us]", "p50", "p99", "p999", "max"],
        ["late", "wake-up", "7", "7", "7", "7"],
        ["policy", "tick", "200", "200", "200", "200"],
        ["plain", "tick", "90", "90", "90", "90"],
        ["[us]", "p50", "p01", "p001", "min"],
        ["slack", "0", "0", "0", "-40"],
        ["missed", "deadlines", "3"],
    ]


def test_memory_is_looked_at_once_a_minute():
    timing = Timing()
    for second in range(181):
        timing.look_at_memory(5 * MINUTE + second * MINUTE // 60)
    memory = timing.report().timekeeping.memory_mb
    assert len(memory) == 5  # at the start, after one, two and three minutes, and now
    # pages of its own: malloc would give some that are free and resident since an earlier test
    with mmap.mmap(-1, 30 << 20) as ballast:
        ballast[:: mmap.PAGESIZE] = bytes(len(ballast) // mmap.PAGESIZE)
        assert memory_mb("VmRSS") - memory[-1] == pytest.approx(30, abs=3)
    assert memory_mb("VmHWM") > memory_mb("VmRSS") + 20
