from hypothesis import given
from hypothesis import strategies as st

from rmll_gaits.load import load_gait
from rmll_gaits.pose import BITS, PAPER_FEET, to_label
from rmll_view.arcs import arcs, cover

UP, DOWN, EITHER = False, True, None


def matches(pattern, label):
    feet = zip(PAPER_FEET, pattern, strict=True)
    return all(down is EITHER or down == bool(label & BITS[foot]) for foot, down in feet)


@given(st.sets(st.integers(0, 15)))
def test_patterns_match_exactly_the_labels(labels):
    patterns = cover(labels)
    matched = {label for label in range(16) if any(matches(p, label) for p in patterns)}
    assert matched == labels
    assert len(patterns) <= 8


def test_a_formula_of_few_feet_is_one_pattern():
    assert cover(range(16)) == ((EITHER,) * 4,)
    assert cover([to_label("FL BR")]) == ((DOWN, UP, UP, DOWN),)
    assert cover([x for x in range(16) if x & BITS["BL"]]) == ((EITHER, EITHER, DOWN, EITHER),)


def test_half_bound_has_four_edges_and_four_ways_into_the_sink():
    table = load_gait("half_bound")
    found = arcs(table)
    assert [(arc.source, arc.target) for arc in found if not arc.rejects] == [
        (0, 1), (1, 2), (2, 3), (3, 0),
    ]  # fmt: skip
    assert [arc.source for arc in found if arc.rejects] == [0, 1, 2, 3]
    assert all(arc.target == table.sink for arc in found if arc.rejects)
    assert [arc.condition for arc in found if arc.rejects] == ["from step 20 on", "", "", ""]


def test_conditions_read_as_in_the_paper():
    conditions = [arc.condition for arc in arcs(load_gait("three_one"))]
    assert conditions == ["φ ≥ N", "φ ≥ N/2", "φ ≥ N", "φ ≥ N/2"]
