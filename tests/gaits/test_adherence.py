"""A robot's way through a gait's automaton."""

from hypothesis import given
from hypothesis import strategies as st

from rmll_gaits.adherence import GaitProgress
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.schedule import schedule, transition_rate
from rmll_gaits.table import ADVANCE

gaits = st.sampled_from(library_names())


def planned(gait: str, frequency: float, rounds: int) -> list[int]:
    """A label each policy step, of a robot that does all in time."""
    plan = schedule(load_gait(gait), frequency)
    once = [p.label for p, n in zip(plan.phases, plan.steps, strict=True) for _ in range(n)]
    return once * rounds


@given(gaits, st.integers(6, 12))
def test_who_does_all_in_time_makes_the_transitions_that_are_allowed(gait, frequency):
    table = load_gait(gait)
    progress, made = GaitProgress(table), 0
    labels = planned(gait, frequency, 6)
    for label in labels:
        progress.step(label, frequency)
        made += progress.advanced
    allowed = len(labels) * float(transition_rate(table, frequency))
    assert allowed - len(set(labels)) - 2 <= made <= allowed + 2


@given(gaits, st.lists(st.integers(0, 15), max_size=60), st.floats(4, 14))
def test_any_labels_keep_it_in_the_gait(gait, labels, frequency):
    table = load_gait(gait)
    progress = GaitProgress(table)
    for count, label in enumerate(labels):
        before, waited = progress.state, progress.phi
        progress.step(label, frequency)
        assert progress.state != table.sink
        if progress.advanced:
            assert count > 0 and progress.phi == 0 and not progress.off_spec
            assert table.effect[before, label] == ADVANCE
            assert waited + 1 >= table.dwell[before, label] * frequency
            assert progress.state == table.next_state[before, label]
        else:
            assert progress.state == before
            assert progress.phi == (waited + 1 if count else 0)


@given(gaits)
def test_the_first_step_of_an_episode_only_looks(gait):
    table = load_gait(gait)
    for label in range(16):
        progress = GaitProgress(table)
        progress.step(label, 8.0)
        assert (progress.state, progress.phi) == (table.start, 0)
        assert not (progress.advanced or progress.off_spec)
        progress.step(label, 8.0)
        progress.reset()
        assert (progress.state, progress.phi, progress.advanced) == (table.start, 0, False)
