"""The shipped trot on feet whose sensors have strong biases, drift, or die; in lockstep."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rmll_hil import lockstep
from rmll_hil.emulator import Emulator, Settings
from rmll_onboard import a1_wire, daemon
from rmll_onboard.bundle import load_bundle
from rmll_onboard.pilot import FlagPilot

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
pytestmark = pytest.mark.skipif(not TROT.exists(), reason="policies/trot.onnx is not there")

BIASES = np.array([60, -60, 40, -30])
"""Raw units, on top of the emulator's own; standing adds about 60"""


class Feet(Emulator):
    """An emulator whose foot readings pass through ``change(readings, seconds)``."""

    def __init__(self, change: Callable[[np.ndarray, float], np.ndarray]) -> None:
        super().__init__(Settings(seed=1))
        self._change = change

    def state_datagram(self) -> bytes:
        state = a1_wire.RobotState()
        a1_wire.decode_state(super().state_datagram(), state)
        changed = self._change(state.foot_force, self.now_ms / 1000)
        state.foot_force = changed.clip(-32768, 32767).astype(np.int16)
        return a1_wire.encode_state(state)


class FixedThresholds:
    """Contacts as from one bias for all feet and all time: the labels without calibration."""

    def __init__(self, settings: object) -> None:
        self.reset()

    def reset(self) -> None:
        self._before = np.zeros(4, bool)

    def rest(self, mode: object, foot_force: np.ndarray) -> None: ...

    def step(self, foot_force: np.ndarray, *_: object) -> tuple[np.ndarray, np.ndarray]:
        pressed = foot_force > 20
        touching = pressed | self._before
        self._before = pressed
        return touching, foot_force < 10

    complaint = None

    def report(self) -> None: ...


def biased(force: np.ndarray, seconds: float) -> np.ndarray:
    return force + BIASES


def drifting(force: np.ndarray, seconds: float) -> np.ndarray:
    return force + 6 * seconds


def sinking(force: np.ndarray, seconds: float) -> np.ndarray:
    return force - 6 * seconds


def trot(
    change: Callable[[np.ndarray, float], np.ndarray], seconds: float = 10.0, frequency: float = 9
) -> dict:
    bundle = load_bundle(TROT)
    pilot = FlagPilot(bundle.table.commands, vx=0.5, frequency=frequency, seconds=seconds)
    return lockstep.walk(Feet(change), bundle, pilot, lambda _: None).report


def test_a_hurried_trot_is_told_in_time_which_feet_are_in_the_air() -> None:
    # with heights that were one policy step old, every second transition came a step late: 0.92
    assert trot(lambda force, _: force, seconds=6.0, frequency=6)["adherence"] > 0.98


@pytest.mark.parametrize("change", [biased, drifting, sinking])
def test_calibration_holds_the_gait(change) -> None:
    report = trot(change)
    assert report["fault"] is None
    assert report["adherence"] > 0.95
    assert report["feet"]["dead"] == []


@pytest.mark.parametrize("change", [biased, drifting])
def test_fixed_thresholds_do_not(change, monkeypatch) -> None:
    monkeypatch.setattr(daemon, "FootContact", FixedThresholds)
    assert trot(change)["adherence"] < 0.5


def test_what_is_measured_is_what_the_sensors_have() -> None:
    """After a walk the readings in the air are known to some units: creep and noise are left."""
    still, moved = (trot(change, 4.0)["feet"]["unloaded"] for change in (lambda f, _: f, biased))
    np.testing.assert_allclose(np.subtract(moved, still), BIASES, atol=3)


@pytest.mark.parametrize(
    ("dead", "since"), [([2], 0.0), ([2], 6.0), ([0, 1, 2, 3], 0.0)], ids=["one", "later", "all"]
)
def test_a_dead_sensor_is_told_and_the_estimator_stands_in(dead, since) -> None:
    def die(force: np.ndarray, seconds: float) -> np.ndarray:
        force = force.copy()
        if seconds >= since:
            force[dead] = -3
        return force

    report = trot(die)
    assert report["feet"]["dead"] == [("FR", "FL", "RR", "RL")[foot] for foot in dead]
    assert any("dead foot sensors" in warning for warning in report["warnings"])
    assert report["fault"] is None
    assert report["adherence"] > 0.8
