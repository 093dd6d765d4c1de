from hypothesis import given
from hypothesis import strategies as st

from rmll_onboard.runtime.report_text import report_text

words = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=12)
values = st.recursive(
    words | st.floats() | st.integers() | st.none() | st.lists(words | st.floats()),
    lambda inner: st.dictionaries(words, inner, max_size=5) | st.lists(inner, max_size=3),
    max_leaves=20,
)


def test_names_stand_on_the_left_and_what_is_nested_beneath_them():
    report = {
        "gait": "trot",
        "falls": 0,
        "fault": None,
        "adherence": 0.98753,
        "tick_us": {"p50": 422.0, "max": 12_345.6},
        "warnings": ["a foot is dead", "the remote was lost"],
        "memory": [79.8, 81.7],
        "provenance": {"commit": "c" * 40, "settings": {f"name{i}": i for i in range(12)}},
    }
    assert report_text(report, 60).splitlines()[:11] == [
        "gait        trot",
        "falls       0",
        "fault       -",
        "adherence   0.9875",
        "tick_us     p50 422  max 12346",
        "warnings    a foot is dead",
        "            the remote was lost",
        "memory      79.8 81.7",
        "provenance",
        "  commit    " + "c" * 40,
        "  settings",
    ]
    assert "    name11  11" in report_text(report, 60).splitlines()


@given(st.dictionaries(words, values, max_size=6))
def test_nothing_is_wider_than_asked_but_a_long_word(report):
    for line in report_text(report).splitlines():
        assert len(line) <= 80 or len(line.split()) <= 2, line
