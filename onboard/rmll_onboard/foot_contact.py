"""From the A1's foot force sensors to the two signals of the labelling function."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rmll_gaits.label import FEET
from rmll_onboard.foot_calibration import FootCalibration
from rmll_onboard.settings import Feet
from rmll_onboard.supervisor import Mode

TOUCHING_HEIGHT, CLEAR_HEIGHT = 0.01, 0.02
"""[m] of the estimator's foot heights; the first counts only where a sensor is dead. In training a
foot is clear from 0.03 m on, but a gait whose feet never seem to be clear would stand still"""


class FootContact:
    """Contact with memory of one policy step, as the trainer's labelling function has it."""

    def __init__(self, settings: Feet) -> None:
        self._settings = settings
        self.calibration = FootCalibration(settings.load)
        self.reset()

    def reset(self) -> None:
        """A walk begins: forget the step before."""
        self._before = np.zeros(4, bool)
        self.calibration.begin()

    def rest(self, mode: Mode, foot_force: NDArray[np.int16]) -> None:
        """Learn from a robot that does not walk, once a policy step."""
        match mode:
            case Mode.DAMPING:
                self.calibration.lie(foot_force)
            case Mode.STANDING_UP:
                self.calibration.rise(foot_force)
            case Mode.STANDING:
                self.calibration.stand(foot_force)

    def step(
        self,
        foot_force: NDArray[np.int16],
        down: NDArray[np.bool_],
        look: Callable[[], NDArray[np.floating]],
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """``touching`` and ``clear`` (4,), once a policy step.

        ``foot_force`` (4,) are raw sensor values, ``down`` (4,) the feet's bits of the last label.
        ``look`` gives the feet's estimated heights (4,) [m] above the ground, which alone count for
        feet without a working sensor. It costs a run of the network, so it is asked only if a bit
        hangs on it.

        A foot is touching if it presses now or did one policy step ago. The sensors cannot see
        height, and a robot that is pushed unloads feet without lifting them: a foot is clear of the
        ground if it bears no load and is high as well. Feet that are up already are not told clear
        unless heights were asked for; their bits do not need it.
        """
        measured = self.calibration
        measured.walk(foot_force)
        share = (foot_force - measured.unloaded) / measured.load
        dead = measured.dead
        pressed, clear = share > self._settings.touching, dead | (share < self._settings.clear)
        lifted_perhaps = down & clear & ~self._before
        if (dead | lifted_perhaps).any():
            height = look()
            pressed = np.where(dead, height < TOUCHING_HEIGHT, pressed)
            clear &= height > CLEAR_HEIGHT
        else:
            clear = np.zeros_like(clear)
        touching = pressed | self._before
        self._before = pressed
        return touching, clear

    @property
    def complaint(self) -> str | None:
        """What the operator should know of the sensors."""
        dead = self._dead_feet()
        return f"dead foot sensors: {' '.join(dead)}; estimated heights stand in" if dead else None

    def report(self) -> dict[str, Any]:
        """Per foot, raw units: the reading in the air and what standing adds; and the dead ones."""
        measured = self.calibration
        return {
            "unloaded": measured.unloaded.round(1).tolist(),
            "load": measured.load.round(1).tolist(),
            "dead": self._dead_feet(),
        }

    def _dead_feet(self) -> list[str]:
        dead = self.calibration.dead
        return [foot for foot, is_dead in zip(FEET, dead, strict=True) if is_dead]
