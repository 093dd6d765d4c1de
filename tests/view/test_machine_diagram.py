import pytest
from matplotlib.figure import Figure

from rmll_gaits.compile import compile_gait
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.spec import read_spec
from rmll_view.machine_diagram import draw_machine

BRANCHES = """
gait: branches
commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}
states:
  a:
    - {when: FL & BR, to: a, dwell: 0}
    - {when: "!FL & (FR | BL)", to: c, dwell: 2}
    - {when: FL & !BR, to: b}
  b: [{when: BL, to: a}]
  c: [{when: BR, to: a}, {when: "!BR", reject: true}]
"""


def draw(table):
    axes = Figure().subplots()
    draw_machine(axes, table)
    return axes


@pytest.mark.parametrize("gait", library_names())
def test_every_state_is_drawn_once_and_apart_from_the_others(gait):
    table = load_gait(gait)
    texts = draw(table).texts
    places = {t.get_text(): t.get_position() for t in texts if t.get_text() in table.states}
    assert set(places) == set(table.states)
    assert len({(round(x, 3), round(y, 3)) for x, y in places.values()}) == table.num_states
    assert [text.get_text() for text in texts].count("start") == 1


def test_loops_branches_and_sinks_are_drawn():
    axes = draw(compile_gait(read_spec(BRANCHES, "branches.yaml")))
    words = [text.get_text() for text in axes.texts]
    assert {"a", "b", "c", "q_r", "at once", "φ ≥ 2 N"} <= set(words)
