"""Every end of a walk keeps the robot on its feet, that of a gait whose feet feel nothing too.

``python tests/hil/test_stop_sequence.py 50`` makes the table of docs/stopping.md.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from rmll_gaits.table import MachineTable
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.runs import lockstep
from rmll_onboard.commands.operator import FlagOperator, OperatorCommand
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import Controller, PolicyInput
from rmll_onboard.protocol.a1_remote import Remote
from rmll_onboard.runtime import daemon
from rmll_onboard.safety.stop_sequence import StopSequence
from rmll_onboard.settings import runtime_settings as onboard
from rmll_onboard.settings.runtime_settings import Motion
from rmll_onboard.state.modes import NS, Mode, Request

Flags = NDArray[np.bool_]
Signals = tuple[Flags, Flags]

POLICIES = Path(__file__).parents[2] / "policies"
GAITS = ("trot", "pace", "bound", "half_bound")
SPEED = 1.0
"""[m/s]"""
AFTER = 1.0
"""[s] that it is watched after it has stopped"""
NUMB = (
    (np.zeros(4, bool), np.zeros(4, bool)),
    (np.ones(4, bool), np.zeros(4, bool)),
    (np.zeros(4, bool), np.ones(4, bool)),
)
"""``touching`` and ``clear`` of feet that feel nothing: neither ever, always down, always up"""
MOTION = Motion(crouch=0.3, rise=0.6, settle=0.2, sit=0.5)
SETTINGS = onboard.RuntimeSettings(motion=MOTION, safety=onboard.Safety(stuck=2.0))
"""Of docs/stopping.md's table; half bounds that are told later fall more often"""


@dataclass(frozen=True)
class End:
    """How a walk ended."""

    upright: bool
    """The base did not touch the ground and there was no fault, until ``AFTER`` it had stopped"""
    stuck: bool
    speed: float
    """[m/s] on the ground, when it was made to stand"""
    warnings: tuple[str, ...]


class _Ending:
    """Walks, asks for ``request`` after ``moment`` [s] (None: never), and finishes some time after
    the robot has stopped."""

    by_remote = False
    complaint = None

    def __init__(self, walk: FlagOperator, moment: float, request: Request | None) -> None:
        self._walk, self._moment, self._request = walk, int(moment * NS), request
        self._now = 0
        self._walking: int | None = None
        self.stopped: int | None = None

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        self._now = now
        orders = self._walk.orders(now, mode, remote)
        if mode is Mode.WALKING:
            self._walking = now if self._walking is None else self._walking
            over = now > self._walking + self._moment
            return orders._replace(request=self._request if over else None)
        if self._walking is None:
            return orders
        self.stopped = now if self.stopped is None else self.stopped
        return orders._replace(request=None)

    def finished(self, mode: Mode, fault: str | None) -> bool:
        stood = self.stopped is not None and self._now > self.stopped + AFTER * NS
        return fault is not None or stood


@contextmanager
def _controller(told: Signals | None, after: int) -> Iterator[None]:
    """The daemon's controller hears ``told`` from its feet ``after`` so many policy steps, but for
    what a stop makes up; None: what they feel."""

    class Numb(Controller):
        heard = 0

        def step(
            self, touching: Flags, clear: Flags, sensed: PolicyInput, command: ArrayLike
        ) -> NDArray[np.float64]:
            self.heard += 1
            if told is not None and self.heard > after and not stops[-1].under_way:
                touching, clear = told
            return super().step(touching, clear, sensed, command)

    class Stop(StopSequence):
        def __init__(self, table: MachineTable, seconds: float) -> None:
            super().__init__(table, seconds)
            stops.append(self)

    stops: list[StopSequence] = []
    before = daemon.Controller, daemon.StopSequence
    daemon.Controller, daemon.StopSequence = Numb, Stop
    try:
        yield
    finally:
        daemon.Controller, daemon.StopSequence = before


def end(gait: str, seed: int, numb: bool = True, request: Request | None = None) -> End:
    """Walk straight on, and end at a random moment.

    Args:
        seed: of the moment, c_f, what the feet tell, and the emulator.
        numb: from the moment on the feet tell always the same.
        request: what the operator wants at that moment; None: to walk on.
    """
    rng = np.random.default_rng(seed)
    bundle = load_bundle(POLICIES / f"{gait}.onnx")
    commands = bundle.table.commands
    moment, frequency = float(rng.uniform(1.2, 2.5)), float(rng.choice(commands.whole_frequencies))
    emulator = Emulator(EmulatorSettings(seed=seed))
    operator = _Ending(FlagOperator(commands, SPEED, 0.0, frequency), moment, request)
    told = NUMB[seed % len(NUMB)] if numb else None
    with _controller(told, after=int(moment * bundle.contract.policy_hz)):
        outcome = lockstep.walk(emulator, bundle, operator, lambda _: None, settings=SETTINGS)
    truth, report = outcome.truth, outcome.report
    stopped = truth["time_ns"][-1] if operator.stopped is None else operator.stopped
    walked = truth["time_ns"] > report.walking_start_ns
    watched = truth[walked & (truth["time_ns"] < stopped + AFTER * NS)]
    velocity = truth["velocity"][np.searchsorted(truth["time_ns"], stopped), :2]
    upright = report.fault is None and not watched["grounded"].any()
    return End(upright, report.stuck_walks > 0, float(np.hypot(*velocity)), report.warnings)


@pytest.mark.parametrize("gait", GAITS)
@pytest.mark.parametrize("seed", range(3))
def test_feet_that_feel_nothing_any_more_at_full_speed(gait: str, seed: int) -> None:
    ended = end(gait, seed)
    assert (ended.upright, ended.stuck) == (True, True)
    assert "gait was stuck" in " ".join(ended.warnings)
    assert ended.speed < 0.45


@pytest.mark.parametrize("numb", [False, True])
def test_all_ends_of_a_walk_are_the_same(numb: bool) -> None:
    """Numb from the very moment at which the operator ends the walk, so that nobody notices."""
    ended = end("trot", 3, numb, Request.STAND)
    assert (ended.upright, ended.stuck, ended.warnings) == (True, False, ())
    assert ended.speed < 0.2


def main(runs: int, gaits: Sequence[str]) -> None:
    print("| gait | runs | fell | stuck | speed when it was made to stand [m/s], at most |")
    print("|---|---|---|---|---|")
    for gait in gaits:
        ends = [end(gait, seed) for seed in range(runs)]
        fell, stuck = sum(not e.upright for e in ends), sum(e.stuck for e in ends)
        fastest = max(e.speed for e in ends)
        print(f"| {gait} | {runs} | {fell} | {stuck} | {fastest:.2f} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:] or GAITS)
