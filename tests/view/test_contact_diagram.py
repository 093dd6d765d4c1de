import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from rmll_gaits.adherence import GaitProgress
from rmll_gaits.compile import compile_gait
from rmll_gaits.load import load_gait
from rmll_gaits.pose import to_label
from rmll_gaits.spec import read_spec
from rmll_view.contact_diagram import (
    contact_figure,
    draw_comparison,
    draw_contacts,
    draw_states,
    find_cycle,
)
from rmll_view.expected import DOWN, EITHER, UP, at_odds, expected
from rmll_view.palette import FOOT_COLOURS, PAPER, REJECT

STEP = 0.02


def axes():
    return Figure().subplots()


def bars(axes):
    """Per colour, the bars as (row, from, to)."""
    found = {}
    for collection in axes.collections:
        colour = to_hex(collection.get_facecolor()[0]) if len(collection.get_paths()) else None
        for path in collection.get_paths():
            (left, bottom), (right, top) = path.get_extents().get_points()
            found.setdefault(colour, []).append((round((bottom + top) / 2), left, right))
    return found


def test_each_foot_has_a_bar_on_its_own_row_while_it_is_down():
    times = np.arange(4) * STEP
    down = np.zeros((4, 4), bool)
    down[1:3, 1] = True  # FL: the second leg of the robot, the first row of the picture
    down[3, 2] = True  # RR: the paper's BR, the last row
    panel = axes()
    draw_contacts(panel, times, down)
    found = bars(panel)
    assert found[FOOT_COLOURS["FL"]] == [(0, pytest.approx(0.02), pytest.approx(0.06))]
    assert found[FOOT_COLOURS["BR"]] == [(3, pytest.approx(0.06), pytest.approx(0.08))]
    assert [label.get_text() for label in panel.get_yticklabels()] == ["FL", "FR", "BL", "BR"]


def test_flags_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"\(3, 4\), expected \(5, 4\)"):
        draw_contacts(axes(), np.arange(5.0), np.zeros((3, 4), bool))


def test_states_are_named_where_there_is_room():
    times = np.arange(200) * STEP
    states = np.zeros(200, int)
    states[100] = 1  # a single step, too short for a name
    panel = axes()
    draw_states(panel, times, states, ("q0", "q1"))
    assert [text.get_text() for text in panel.texts] == ["q0", "q0"]


def log(*stretches):
    """Times and states of stretches (state, steps)."""
    states = np.concatenate([np.full(steps, state) for state, steps in stretches])
    return np.arange(len(states)) * STEP, states


def test_the_full_cycle_nearest_to_the_middle_is_found():
    times, states = log((0, 5), (1, 10), (0, 10), (1, 10), (0, 10), (1, 10), (0, 5))
    assert find_cycle(times, states, load_gait("trot")) == pytest.approx((0.3 + 0.2, 0.9))


def test_a_broken_cycle_is_none():
    table = load_gait("half_bound")
    assert find_cycle(*log((0, 5), (1, 9), (2, 9), (4, 30)), table) is None
    assert find_cycle(*log((0, 9)), table) is None


@pytest.mark.parametrize("steps", [1, 2, 40, 1000])
def test_a_log_of_any_length_becomes_a_picture(tmp_path, steps):
    times = np.arange(steps) * STEP
    states = times // 0.12 % 2
    down = np.stack([states == 0, states == 1, states == 1, states == 0], axis=1)
    file = tmp_path / "trot.png"
    off_spec = np.arange(steps) % 3 == 1
    gait = load_gait("trot")
    contact_figure(file, times, down, states.astype(int), gait, off_spec, "costs $1 and $2")
    assert file.read_bytes().startswith(b"\x89PNG")


def feet(*poses):
    """Which feet are down in each pose, in the robot's order."""
    labels = np.array([to_label(pose) for pose in poses])
    return (labels[:, None] >> np.arange(4) & 1).astype(bool)


def test_expected_is_the_pose_that_led_into_the_state():
    table = load_gait("trot")
    found = expected(np.array([0, 1, 1]), table)
    assert ((found == DOWN) == feet("FR BL", "FL BR", "FL BR")).all()
    assert ((found == DOWN) | (found == UP)).all()
    # while the gallop waits in q2, the back left foot may still be down
    gallop = expected(np.array([2]), load_gait("rotary_gallop"))
    assert gallop.tolist() == [[UP, UP, DOWN, EITHER]]  # FR FL BR BL


def test_a_state_that_nothing_leads_to_expects_what_it_holds():
    states = "  a: [{when: FL & !FR, to: b}]\n  b: [{when: FR & !FL & !BL & !BR, to: b}]"
    head = "gait: g\ncommands: {vx: [0, 1], wz: [0, 1], frequency: [6, 12]}\nstates:\n"
    table = compile_gait(read_spec(head + states, "g.yaml"))
    assert expected(np.array([0]), table).tolist() == [[DOWN] * 4]


@pytest.mark.parametrize(
    ("gait", "state", "pose", "odd"),
    [
        ("trot", 1, "FL FR BL BR", "FR BL"),  # the other diagonal has come, or this one stayed
        ("trot", 1, "FL", "BR"),
        ("trot", 1, "FR FL BR", "FR"),
        ("trot", 1, "FR BL BR", "BR"),  # two steps from what was, one from what is to come
        ("half_bound", 0, "FL FR BL", "BL"),
        ("walk", 0, "FL", "FR BR"),
    ],
)
def test_the_fewest_feet_that_would_have_to_be_otherwise_are_at_odds(gait, state, pose, odd):
    table, down, off = load_gait(gait), feet(pose), np.array([True])
    (found,) = at_odds(np.array([state]), down, off, table)
    assert (found == feet(odd)[0]).all()
    assert not at_odds(np.array([state]), down, ~off, table).any()


def test_no_foot_is_at_odds_in_a_step_that_is_explained():
    table, progress = load_gait("half_bound"), GaitProgress(load_gait("half_bound"))
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 16, 300)
    steps = []
    for label in labels.tolist():
        progress.step(label, 2)
        steps.append((progress.state, progress.off_spec))
    states, off_spec = (np.array(column) for column in zip(*steps, strict=True))
    wrong = at_odds(states, (labels[:, None] >> np.arange(4) & 1).astype(bool), off_spec, table)
    assert (wrong.any(axis=1) == off_spec).all()
    assert 0 < off_spec.sum() < len(labels)


def test_expected_and_measured_are_drawn_and_what_is_off_spec_is_red():
    times, states = np.arange(4) * STEP, np.ones(4, int)
    down = feet("FL BR", "FL FR BR", "FL", "FL BR")
    off_spec = np.array([False, True, True, False])
    panel = axes()
    draw_comparison(panel, times, down, states, off_spec, load_gait("trot"))
    found = bars(panel)
    whole, second = (pytest.approx(0), pytest.approx(0.08)), pytest.approx(0.02)
    assert found[FOOT_COLOURS["FL"]] == [(0, *whole), (0, *whole)]  # expected and measured
    assert found[FOOT_COLOURS["FR"]] == [(1, second, pytest.approx(0.04))]  # not expected
    assert found[REJECT] == [(1, second, pytest.approx(0.04))]  # a foot too many
    assert found[PAPER] == [(3, pytest.approx(0.04), pytest.approx(0.06))]  # and one missing
    (band,) = [p for p in panel.patches if to_hex(p.get_facecolor()) == REJECT]
    assert (band.get_x(), band.get_width()) == (second, pytest.approx(0.04))
    assert (band.get_y(), band.get_height()) == (0, 1)  # across both
