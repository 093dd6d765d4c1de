import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_gaits import pose
from rmll_gaits.formula import parse

labels = st.integers(0, 15)


@given(labels)
def test_words_and_guards_of_a_label_lead_back_to_it(label):
    assert pose.to_label(pose.to_text(label)) == label
    assert parse(pose.to_guard(label)) == {label}


def test_the_paper_s_back_feet_are_the_robot_s_rear_feet():
    assert pose.to_label("BL BR") == pose.to_label("RR RL") == 12
    assert (pose.to_label("FR"), pose.to_label("FL")) == (1, 2)
    assert pose.to_text(0) == "none"


@pytest.mark.parametrize(
    ("text", "message"),
    [("FL XX", "found 'XX'"), ("FL none", "found 'none'"), ("BL RL", "RL twice"), ("fl", "'fl'")],
)
def test_other_words_are_no_pose(text, message):
    with pytest.raises(InputError, match=message):
        pose.to_label(text)
