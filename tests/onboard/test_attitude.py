"""Gravity in the base frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_onboard.state.attitude import projected_gravity, roll_pitch

angles = st.floats(-1.5, 1.5)


@given(angles, angles, st.floats(-3, 3))
def test_roll_and_pitch_come_back_whatever_the_heading(roll, pitch, yaw):
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(angle / 2), math.sin(angle / 2)) for angle in (roll, pitch, yaw)
    )
    quaternion = np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
    gravity = projected_gravity(quaternion)
    assert np.linalg.norm(gravity) == pytest.approx(1)
    assert roll_pitch(gravity) == pytest.approx((roll, pitch), abs=1e-6)


def test_level_means_gravity_along_minus_z():
    assert projected_gravity(np.array([1.0, 0, 0, 0])).tolist() == [0, 0, -1]


@pytest.mark.parametrize("length", [0.0, 0.5, 2.0, 1e30])
def test_what_is_no_rotation_gives_no_gravity(length):
    assert np.isnan(projected_gravity(np.array([length, 0, 0, 0]))).all()
