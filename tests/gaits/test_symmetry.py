"""The mirror image of a gait is the gait: stepping it and mirroring it commute."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_gaits.compile import compile_gait
from rmll_gaits.label import FEET, feet
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.machine import Machine, explained, step
from rmll_gaits.spec import read_spec
from rmll_gaits.symmetry import MIRROR_FEET, mirror_label, mirror_states
from rmll_gaits.table import MachineTable

PAPER = {
    "bound": (0, 1),
    "half_bound": (2, 3, 0, 1, 4),
    "pace": (1, 0),
    "three_one": (2, 3, 0, 1),
    "trot": (1, 0),
    "walk": (2, 3, 0, 1),
}
SYMMETRIC = [name for name in library_names() if mirror_states(load_gait(name)) is not None]


def gait(rules: str) -> MachineTable:
    head = "gait: made_up\ncommands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}\n"
    return compile_gait(read_spec(head + rules, "made_up.yaml"))


@pytest.mark.parametrize("name, expected", PAPER.items())
def test_each_gait_of_the_paper_has_its_symmetry(name, expected):
    assert mirror_states(load_gait(name)) == expected


@given(st.integers(0, 15))
def test_a_label_mirrors_by_swapping_left_and_right_feet(label):
    swapped = {name[0] + {"L": "R", "R": "L"}[name[1]] for name in feet(label)}
    assert set(feet(mirror_label(label))) == swapped
    assert mirror_label(mirror_label(label)) == label
    assert {FEET[MIRROR_FEET[FEET.index(name)]] for name in feet(label)} == swapped


@given(st.integers(0, 2**32 - 1))
def test_stepping_commutes_with_mirroring(seed):
    rng = np.random.default_rng(seed)
    for name in SYMMETRIC:
        table = load_gait(name)
        machine, images = Machine.of(table), np.array(mirror_states(table))
        assert (images[images] == np.arange(table.num_states)).all()
        count = 8
        frequency = rng.integers(5, 13, count)
        phi = rng.integers(0, 15, count)
        state = rng.integers(0, table.num_states, count)
        image = images[state]
        # from an age beyond every grace on
        for age in range(table.grace.max(), table.grace.max() + 25):
            label = rng.integers(0, 16, count)
            mirrored = mirror_label(label)
            told = explained(machine, state, label), explained(machine, image, mirrored)
            standing = label == 15
            assert (told[0] == told[1])[~standing].all()
            one = step(machine, state, phi, label, frequency, age)
            other = step(machine, image, phi, mirrored, frequency, age)
            assert (images[one.state] == other.state).all()
            for ours, theirs in zip(one[1:], other[1:], strict=True):
                assert (ours == theirs).all()
            state, phi, image = one.state, one.phi, other.state


@pytest.mark.parametrize(
    "rules",
    [
        "cycle: [FL, BL, FR, BR, FL BL]",
        "cycle: [FL BL, FR, BL, BR]",
        "cycle: [FL BR, {feet: FR BL, dwell: 0.5}]",  # left and right limp differently
        "start: a\nstates:\n  a: [{when: FL, to: b}]\n  b: [{when: FR, to: a}, "
        "{when: BL & !FR, reject: true}]",  # only the left foot is forbidden
        "start: a\nstates:\n  a: {edges: [{when: FL & !FR, to: b}], hold: FL & BL}\n"
        "  b: {edges: [{when: FR & !FL, to: a}], hold: BL & !FR}",
    ],
)
def test_a_lopsided_gait_has_none(rules):
    assert mirror_states(gait(rules)) is None


def test_a_gallop_with_its_lead_written_down_has_none():
    assert mirror_states(gait("cycle: [BL, BR, FL, FR]")) is None


def test_the_cycle_of_single_feet_that_alternates_sides_has_one():
    assert mirror_states(gait("cycle: [FL, BR, FR, BL]")) == (2, 3, 0, 1)


def test_a_grace_may_stand_on_one_side_only():
    assert load_gait("half_bound").grace[0].any() and not load_gait("half_bound").grace[2].any()


@given(st.integers(0, 2**32 - 1))
def test_an_automaton_joined_with_its_mirror_image_is_found_symmetric(random_table, seed):
    """Two copies, the second one mirrored, with a common start that both halves can be."""
    table = random_table(seed)
    count, labels = table.num_states, mirror_label(np.arange(16))
    # a transition changes the copy, so that both are in reach
    here, there = np.arange(count), np.arange(count) + count
    moves = table.effect != 0
    stays = here[:, None]
    first = np.where(moves, there[table.next_state], stays)
    second = np.where(moves[:, labels], table.next_state[:, labels], stays + count)
    twice = MachineTable(
        gait="twice",
        states=tuple(f"q{i}" for i in range(2 * count)),
        start=table.start,
        sink=None,
        commands=table.commands,
        next_state=np.concatenate([first, second]),
        effect=np.concatenate([table.effect, table.effect[:, labels]]),
        dwell=np.concatenate([table.dwell, table.dwell[:, labels]]),
        grace=np.concatenate([table.grace, table.grace[:, labels]]),
        hold=np.concatenate([table.hold, table.hold[:, labels]]),
    )
    images = mirror_states(twice)
    assert images is None or sorted(images) == list(range(2 * count))
    reached = _reach(twice)
    if reached.all():
        assert images is not None


def _reach(table: MachineTable) -> np.ndarray:
    reached = np.zeros(table.num_states, bool)
    reached[table.start] = True
    for _ in range(table.num_states):
        reached[table.next_state[reached].ravel()] = True
    return reached
