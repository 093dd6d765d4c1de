"""The one way out of walking, whoever ends the walk."""

import pytest

from rmll_gaits.adherence import GaitProgress
from rmll_gaits.label import label
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.schedule import main_cycle, schedule
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.safety.stop_sequence import StopSequence
from rmll_onboard.state.modes import Mode, Request

WALK = (0.5, 0.3, 8.0)
ON_THE_SPOT = (0.0, 0.0, 8.0)


class At:
    """A stop of a second, asked at any time [s]."""

    def __init__(self) -> None:
        self.stop = StopSequence(load_gait("trot"), seconds=1.0)

    def __call__(self, seconds, request, stuck=False, mode=Mode.WALKING):
        return self.stop.orders(int(seconds * 1e9), mode, OperatorCommand(request, WALK), stuck)


@pytest.fixture
def at():
    return At()


@pytest.mark.parametrize("request_", [Request.STAND, Request.SIT])
def test_every_wish_to_end_a_walk_is_a_second_on_the_spot_first(at, request_):
    assert at(0.0, None) == OperatorCommand(None, WALK)
    assert not at.stop.under_way
    for second in (0.1, 0.6, 1.09):
        assert at(second, request_) == OperatorCommand(None, ON_THE_SPOT)
        assert at.stop.under_way
    assert at(1.1, request_) == OperatorCommand(request_, ON_THE_SPOT)
    assert at.stop.stuck_walks == 0


def test_a_stuck_gait_stops_as_all_others_do_and_stands(at):
    assert at(0.0, None, stuck=True) == OperatorCommand(None, ON_THE_SPOT)
    # once the poses follow the clock, it is stuck no more
    assert at(0.5, None) == OperatorCommand(None, ON_THE_SPOT)
    assert at(1.0, None) == OperatorCommand(Request.STAND, ON_THE_SPOT)
    assert at.stop.stuck_walks == 1


def test_a_button_need_not_be_held_and_walk_calls_a_stop_off(at):
    at(0.1, Request.STAND)
    assert at(0.2, None) == OperatorCommand(None, ON_THE_SPOT)
    assert at(0.3, Request.WALK) == OperatorCommand(Request.WALK, WALK)
    assert not at.stop.under_way
    at(0.4, Request.SIT)
    assert at(1.3, None).request is None
    assert at(1.4, None) == OperatorCommand(Request.SIT, ON_THE_SPOT)


def test_a_stuck_gait_is_not_walked_on_by_a_button_that_is_held(at):
    at(0.0, Request.WALK, stuck=True)
    assert at(0.5, Request.WALK) == OperatorCommand(None, ON_THE_SPOT)
    assert at(1.0, Request.WALK) == OperatorCommand(Request.STAND, ON_THE_SPOT)


def test_the_last_wish_counts_also_when_the_gait_is_stuck(at):
    at(0.0, Request.STAND)
    at(0.2, Request.SIT)
    assert at(1.0, None).request is Request.SIT
    at(2.0, None, mode=Mode.STANDING)
    at(3.0, None, stuck=True)
    at(3.5, Request.SIT)
    assert at(4.0, None).request is Request.SIT


def test_a_wish_to_sit_is_not_lost_to_a_gait_that_sticks_meanwhile(at):
    at(0.0, Request.SIT)
    at(0.5, None, stuck=True)
    assert at(1.0, None).request is Request.SIT


def test_a_stop_that_was_called_off_leaves_no_wish(at):
    at(0.0, Request.SIT)
    at(0.2, Request.WALK)
    at(0.5, None, stuck=True)
    assert at(1.4, None).request is None
    assert at(1.5, None).request is Request.STAND


def test_without_a_walk_all_wishes_pass_and_a_stop_is_forgotten(at):
    at(0.0, None, stuck=True)
    for mode in (mode for mode in Mode if mode is not Mode.WALKING):
        for request in (*Request, None):
            assert at(0.5, request, mode=mode) == OperatorCommand(request, WALK)
            assert not at.stop.under_way
    at(9.0, None, stuck=True)  # the next walk
    assert at(9.5, None).request is None
    assert at.stop.stuck_walks == 2


@pytest.mark.parametrize("gait", library_names())
@pytest.mark.parametrize("frequency", [5.0, 6.5, 12.0])
def test_its_poses_lead_the_automaton_round_at_the_pace_of_c_f(gait, frequency):
    table = load_gait(gait)
    stop, progress = StopSequence(table, 1.0), GaitProgress(table)
    cycle = {phase.state for phase in main_cycle(table)}
    plan = schedule(table, frequency)
    made = 0
    for _ in range(1 + 10 * plan.period_steps):
        touching, clear = stop.contacts(progress.state)
        assert (touching != clear).all()
        progress.step(int(label(touching)), frequency)
        assert not progress.off_spec
        made += progress.advanced
        assert progress.state in cycle | {table.start}
    assert made == pytest.approx(10 * len(plan.phases), abs=2)


def test_from_any_state_of_any_gait_there_is_a_way_on():
    for gait in library_names():
        table = load_gait(gait)
        stop = StopSequence(table, 1.0)
        for state in set(range(table.num_states)) - {table.sink}:
            pose = int(label(stop.contacts(state)[0]))
            assert table.next_state[state, pose] != state


def test_a_sink_waits_for_nothing(bundle):
    touching, clear = StopSequence(bundle.table, 1.0).contacts(bundle.table.sink)
    assert touching.all()
    assert not clear.any()
