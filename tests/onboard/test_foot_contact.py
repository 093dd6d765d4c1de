"""Foot forces to contact signals."""

import numpy as np

from rmll_onboard.foot_contact import FootContact
from rmll_onboard.settings import Feet


def test_touching_remembers_one_step_and_clear_does_not():
    feet = FootContact(Feet(touching=20, clear=10))
    touching, clear = feet.step(np.array([100, 21, 15, -30], np.int16))
    assert touching.tolist() == [True, True, False, False]
    assert clear.tolist() == [False, False, False, True]
    touching, clear = feet.step(np.array([0, 20, 10, 9], np.int16))
    assert touching.tolist() == [True, True, False, False]
    assert clear.tolist() == [True, False, False, True]
    touching, _ = feet.step(np.zeros(4, np.int16))
    assert not touching.any()


def test_reset_forgets_the_step_before():
    feet = FootContact(Feet())
    feet.step(np.full(4, 100, np.int16))
    feet.reset()
    assert not feet.step(np.zeros(4, np.int16))[0].any()
