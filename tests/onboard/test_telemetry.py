"""What is kept of a tick, watched on a walk."""

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import asdict

from rmll_common.errors import InputError
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.recording.mcap_writer import SCHEMA
from rmll_onboard.recording.telemetry import TelemetryRow, columns, row, row_type
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.tick_listener import TickListener
from rmll_onboard.state.modes import Request


@pytest.fixture
def daemon(bundle, brisk):
    operator = FlagOperator(bundle.table.commands, 0.5, 0.0, 8.0, seconds=1.0)
    return Daemon(bundle, brisk, operator)


@pytest.fixture
def ticks(daemon, robot):
    """A walk of a second, with the daemon's controller as it was at the end."""
    kept, datagrams, now = [], [], 0
    listener = TickListener(daemon, kept.append)
    while not daemon.finished:
        now += daemon.period
        answer = daemon.tick(now, datagrams)
        listener.observe(now, datagrams, answer)
        datagrams = [robot.answer(answer)]
    return kept


def test_every_tick_is_kept_with_all_that_went_in_and_out(ticks, daemon):
    assert [tick.number for tick in ticks] == list(range(len(ticks)))
    assert [tick.now for tick in ticks] == [(i + 1) * daemon.period for i in range(len(ticks))]
    assert [len(tick.datagrams) for tick in ticks] == [0] + [1] * (len(ticks) - 1)
    assert {len(tick.answer) for tick in ticks} == {610}
    requests = list(dict.fromkeys(tick.request for tick in ticks if tick.request))
    assert requests == [Request.STAND, Request.WALK, Request.SIT]
    assert {tick.command for tick in ticks} == {(0.5, 0.0, 8.0)}


def test_the_inside_is_kept_at_the_policys_rate(ticks, bundle):
    kind = row_type(columns(bundle.contract))
    rows = [row(t.now, t.inside, bundle.table.states, kind) for t in ticks if t.inside]
    order = list(dict.fromkeys(r.mode for r in rows if r.mode != "standing"))
    assert order == ["damping", "standing_up", "walking", "sitting_down"]
    walking = [r for r in rows if r.mode == "walking"]
    assert len(walking) == 51 + 5
    assert max(r.vx for r in walking) == 0.5
    assert sum(r.advanced for r in walking) == pytest.approx(6, abs=1)
    for r in walking:
        down = [getattr(r, f"down_{foot}") for foot in ("FR", "FL", "RR", "RL")]
        assert sum(bit << foot for foot, bit in enumerate(down)) == r.label
    assert {b.t_ns - a.t_ns for a, b in pairwise(walking)} == {20_000_000}


def test_the_numbers_of_the_inside_are_the_controllers(ticks, bundle, daemon):
    last = [tick for tick in ticks if tick.inside][-1]
    kind = row_type(columns(bundle.contract))
    named = asdict(row(last.now, last.inside, bundle.table.states, kind))
    controller = daemon.controller
    for name, value in zip(bundle.contract.joint_names, controller.target, strict=True):
        assert named[f"target_{name}"] == pytest.approx(value, rel=1e-7)
    observed = [value for name, value in named.items() if name.startswith("observation_")]
    # to the last bit, in spite of the rounding to nine digits
    np.testing.assert_array_equal(np.array(observed, np.float32), controller.observation)


@pytest.mark.parametrize("names", [["a b"], ["mode"], ["__class__"], ["a", "a"], [""]])
def test_a_name_that_cannot_be_a_column_is_refused(names):
    with pytest.raises(InputError, match="column"):
        row_type(names)


def test_a_logs_schema_names_the_columns_of_its_rows():
    assert tuple(SCHEMA) == TelemetryRow.__struct_fields__
