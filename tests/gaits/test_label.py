import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from rmll_gaits.label import FEET, feet, hysteresis, label

flags = hnp.arrays(bool, (7, 3, 4))


def test_bits_follow_the_robot_s_legs():
    for bit, name in enumerate(FEET):
        assert label(np.arange(4) == bit) == 1 << bit
        assert feet(1 << bit) == (name,)


@pytest.mark.parametrize(
    ("down", "touching", "clear", "expected"),
    [
        (False, False, False, False),
        (True, False, False, True),
        (True, False, True, False),
        (False, True, False, True),
        (True, True, True, True),
    ],
)
def test_a_foot_between_contact_and_clear_air_keeps_its_flag(down, touching, clear, expected):
    arrays = (np.array([value]) for value in (down, touching, clear))
    assert hysteresis(*arrays) == expected


@given(hnp.arrays(bool, (4,)))
def test_feet_name_the_flags_of_a_label(down):
    assert feet(int(label(down))) == tuple(np.array(FEET)[down])


@given(hnp.arrays(bool, (3, 4)), flags, flags)
def test_numpy_and_torch_label_random_signals_alike(down, touching, clear):
    twin = torch.from_numpy(down.copy())
    for now, air in zip(touching, clear, strict=True):
        down = hysteresis(down, now, air)
        twin = hysteresis(twin, torch.from_numpy(now), torch.from_numpy(air))
        assert (twin.numpy() == down).all()
        assert label(twin).tolist() == label(down).tolist()


@given(st.integers(0, 15))
def test_labels_and_feet_are_inverse(value):
    assert sum(1 << FEET.index(name) for name in feet(value)) == value
