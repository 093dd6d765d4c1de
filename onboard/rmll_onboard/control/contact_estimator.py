"""From what is known of the load on each foot to the two signals of the labelling function.

Two sources tell it, both in newtons: the joint torques of the leg, on every robot and from the
first step on; and a foot's own sensor, where the robot has one, once :mod:`foot_sensor` has learnt
it and for as long as it is not doubted. The sensor is the better one: the shake of a foot that
touches down is in the torques, but not in the sensor.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rmll_gaits.label import FEET
from rmll_onboard.control.foot_calibration import FootCalibration
from rmll_onboard.control.leg_force import LegForce
from rmll_onboard.settings.runtime_settings import Feet
from rmll_onboard.state.attitude import GRAVITY
from rmll_onboard.state.modes import Mode
from rmll_onboard.state.reports import FeetReport
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import Robot

Array = NDArray[np.float64]

CLEAR_HEIGHT = 0.02
"""[m] of the estimator's foot heights. In training a foot is clear from 0.03 m on, but a gait whose
feet never seem to be clear would stand still"""
FIRM = 1.5
"""So many times more than what counts as a touch has to be on a foot in the air: both sources err
by some newtons in a swing, and a pronk that feels one foot waits for its next leap"""
BORNE = 0.8, 1.2
"""Of the robot's weight, by torque: it stands on its feet, and not on its belly or in a person's
hands"""


class ContactEstimator:
    """Contact with memory of one policy step, as the trainer's labelling function has it."""

    def __init__(self, settings: Feet, robot: Robot, sensors: bool) -> None:
        """``sensors``: the robot's states bring readings of foot sensors."""
        self._weight = robot.mass * GRAVITY
        self._load = self._weight / len(FEET)
        self._pressed, self._clear = settings.touching * self._load, settings.clear * self._load
        self._firm = FIRM * self._pressed
        self._legs = LegForce(robot)
        self.sensors: Sequence[FootCalibration] = [
            FootCalibration(self._load, self._pressed, foot) for foot in range(len(FEET)) if sensors
        ]
        """One a foot, or none"""
        self._before = np.zeros(len(FEET), bool)
        self._force: Sequence[float] = [0.0] * len(FEET)
        self._raw: Sequence[int] = ()
        self._heights: Array | None = None  # [m] above the hips, in the newest step
        self._risen: Array | float = 0.0  # [m] since the step before

    def reset(self) -> None:
        """A walk begins: forget the step before."""
        self._before = np.zeros(len(FEET), bool)
        for sensor in self.sensors:
            sensor.begin()

    def measured(self, now: int, dq: Array) -> None:
        """A new state came, measured at ``now`` [ns], whose joints turn at ``dq`` [rad/s] (12,)."""
        self._legs.turn(now, dq)

    def rest(self, mode: Mode, state: RobotState, gravity: Array) -> None:
        """Follow the sensors of a robot that does not walk, once a policy step."""
        if mode in (Mode.STANDING_UP, Mode.STANDING) and self.sensors:
            self._feel(state, gravity)
            low, high = BORNE
            # written so that what is no number bears nothing
            if low * self._weight < sum(self._force) < high * self._weight:
                for sensor, raw, force in zip(self.sensors, self._raw, self._force, strict=True):
                    sensor.stand(raw, force)

    def step(
        self,
        state: RobotState,
        gravity: Array,
        down: NDArray[np.bool_],
        heights: NDArray[np.floating],
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """``touching`` and ``clear`` (4,), once a policy step.

        ``gravity`` (3,) is its unit vector in the base frame, ``down`` (4,) are the feet's bits of
        the last label, ``heights`` (4,) [m] above the ground are what the policy's estimator said
        in the last step. Since then a foot that lifts has risen by centimetres: as far as its leg
        tells, that is added.

        A foot is touching if it presses now or did one policy step ago. Forces do not tell height,
        and a robot that is pushed unloads feet without lifting them: a foot is clear of the ground
        if it bears no load and is high as well.
        """
        load = np.array(self._loads(state, gravity))
        pressed = load > np.where(down, self._pressed, self._firm)
        clear = (load < self._clear) & (heights + self._risen > CLEAR_HEIGHT)
        touching = pressed | self._before
        self._before = pressed
        return touching, clear

    @property
    def doubts(self) -> dict[str, str]:
        """Per foot whose sensor is doubted: why."""
        feet = zip(FEET, self.sensors, strict=False)
        return {foot: sensor.doubt for foot, sensor in feet if sensor.doubt}

    @property
    def complaints(self) -> list[str]:
        """What the operator should know of the sensors."""
        return [
            f"foot sensor {foot}: {doubt}; the leg's torques stand in"
            for foot, doubt in self.doubts.items()
        ]

    def told(self, awaited: Sequence[tuple[int, bool]]) -> str:
        """In words, which feet should be on the ground or off it, and what they read instead."""
        feet = [
            f"{FEET[foot]} {'on' if down else 'off'} the ground ({self._read(foot)})"
            for foot, down in awaited
        ]
        return ", ".join(feet) or "no foot"

    def report(self) -> FeetReport:
        """Per foot: what contact came from at the end, and what was learnt of the sensor."""
        trusted = [sensor.trusted for sensor in self.sensors] or [False] * len(FEET)
        return FeetReport(
            contact_by=tuple("sensor" if by_sensor else "torque" for by_sensor in trusted),
            gain=tuple(round(s.gain, 3) if s.trusted else None for s in self.sensors),
            bias=tuple(round(s.bias, 1) if s.trusted else None for s in self.sensors),
            doubts=self.doubts,
        )

    def _read(self, foot: int) -> str:
        force = f"{max(0.0, self._force[foot]):.0f} N by the leg's torques"
        if not self.sensors:
            return force
        sensor, raw = self.sensors[foot], self._raw[foot]
        if sensor.trusted:
            return f"{raw} raw, {sensor.newtons(raw):.0f} N by the sensor; {force}"
        return f"{raw} raw; {force}; its sensor {sensor.doubt or 'is not learnt yet'}"

    def _loads(self, state: RobotState, gravity: Array) -> Sequence[float]:
        """[N] on each foot, by the better source; the sensors learn from the other one."""
        self._feel(state, gravity)
        if not self.sensors:
            return self._force
        feet = zip(self.sensors, self._raw, self._force, strict=True)
        return [sensor.walk(raw, force) for sensor, raw, force in feet]

    def _feel(self, state: RobotState, gravity: Array) -> None:
        self._force = self._legs.step(state.q, state.tau, gravity)
        heights = np.array(self._legs.heights)
        self._risen = 0.0 if self._heights is None else heights - self._heights
        self._heights = heights
        if self.sensors:
            self._raw = state.foot_force.tolist()
