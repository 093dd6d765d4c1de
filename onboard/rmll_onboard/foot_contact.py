"""From the A1's foot force sensors to the two signals of the labelling function."""

import numpy as np
from numpy.typing import NDArray

from rmll_onboard.settings import Feet


class FootContact:
    """Contact with memory of one policy step, as the trainer's labelling function has it."""

    def __init__(self, settings: Feet) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the step before."""
        self._before = np.zeros(4, bool)

    def step(self, foot_force: NDArray[np.int16]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """``touching`` and ``clear`` (4,) from raw sensor values (4,), once a policy step.

        A foot is touching if it presses now or did one policy step ago. The sensors cannot see
        height, so a foot without load is taken to be clear of the ground.
        """
        pressed = foot_force > self._settings.touching
        touching = pressed | self._before
        self._before = pressed
        return touching, foot_force < self._settings.clear
