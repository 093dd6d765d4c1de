import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from rmll_gaits.load import load_gait
from rmll_view.contacts import contact_figure, draw_contacts, draw_states, find_cycle
from rmll_view.palette import FOOT_COLOURS

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
    contact_figure(file, times, down, states.astype(int), load_gait("trot"), "costs $1 and $2")
    assert file.read_bytes().startswith(b"\x89PNG")
