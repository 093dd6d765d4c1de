"""How well each gait walks on foot sensors whose unit nobody told the daemon.

The same walk twice, in lockstep: once with a daemon that has to learn, once with one that is told
the true unit and bias of each foot at every moment. Their adherence is to be the same.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from rmll_gaits.table import nearest
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.sensors import FootSensors, FootUnits, Noise
from rmll_hil.runs import lockstep, metrics
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.control.foot_calibration import FootCalibration
from rmll_onboard.runtime.daemon import Daemon

TOLERANCE = 0.02
"""The most adherence that not being told may cost"""
GAINS = 0.2, 0.5, 1.0, 2.0, 5.0, 20.0
BIASES = -500.0, 0.0, 500.0
SHARE = 0.05
"""Of noise: of a foot's usual load"""
DRIFT = 20.0
_SPEED = 0.5
_FINE = Noise(foot_force=0.0, foot_noise_share=SHARE)
"""Noise that grows with the unit; the emulator's own unit of it is a sixth of the load at 0.2"""


@dataclass(frozen=True)
class Case:
    """Four foot sensors."""

    name: str
    units: FootUnits
    noise: Noise = _FINE


CASES = (
    *(
        Case(f"gain {gain:g}, bias {bias:g}", FootUnits(gain, bias))
        for gain in GAINS
        for bias in BIASES
    ),
    *(
        Case(f"gain {gain:g}, drift {drift:g}/s", FootUnits(gain, 0.0, drift))
        for gain in (0.2, 2.0, 20.0)
        for drift in (-DRIFT, DRIFT)
    ),
    Case("gain 2, noise of a raw unit only", FootUnits(2.0), Noise()),
    Case("gain 0.2, noise of a raw unit", FootUnits(0.2), Noise()),
    Case("FL 0.4, others 2", FootUnits((2.0, 0.4, 2.0, 2.0))),
    Case("RR 20, others 2", FootUnits((2.0, 2.0, 20.0, 2.0))),
)


@dataclass(frozen=True)
class FeetResult:
    """One gait on one case."""

    case: str
    gait: str
    learnt: float
    """Adherence of the daemon that learns"""
    told: float
    """Of the one that is told"""
    falls: int
    fault: str | None
    doubts: dict[str, str]
    """Feet whose sensor it did not believe at the end, and why"""

    @property
    def as_expected(self) -> bool:
        return not self.falls and not self.fault and self.learnt >= self.told - TOLERANCE


class _Told(FootCalibration):
    """Knows what the emulator knows."""

    def __init__(self, feet: FootSensors, foot: int) -> None:
        super().__init__(usual=1.0, pressed=1.0)
        self.trusted = True
        self._feet, self._foot = feet, foot

    def walk(self, raw: int, force: float) -> float:
        self.gain = float(self._feet.gain[self._foot])
        self.bias = float(self._feet.bias[self._foot])
        return self.newtons(raw)


def walk_all(
    cases: Sequence[Case], policies: Sequence[Path], seconds: float, jobs: int
) -> Iterator[FeetResult]:
    """Each case on each policy, in order; ``jobs`` at a time."""
    tasks = [(case, policy, seconds) for case in cases for policy in policies]
    if jobs == 1:
        yield from map(_compare, tasks)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(_compare, tasks)


def _compare(task: tuple[Case, Path, float]) -> FeetResult:
    case, policy, seconds = task
    bundle = load_bundle(policy)
    learnt, doubts = _walk(case, bundle, seconds, told=False)
    told, _ = _walk(case, bundle, seconds, told=True)
    return FeetResult(
        case.name,
        bundle.contract.gait,
        learnt.adherence or 0.0,
        told.adherence or 0.0,
        learnt.falls,
        learnt.fault,
        doubts,
    )


def _walk(
    case: Case, bundle: Bundle, seconds: float, told: bool
) -> tuple[metrics.RunSummary, dict[str, str]]:
    """The figures, and the feet whose sensor was doubted."""
    emulator = Emulator(EmulatorSettings(seed=1), case.noise, bundle.robot, feet=case.units)
    commands = bundle.table.commands
    operator = FlagOperator(commands, nearest(_SPEED, commands.vx), seconds=seconds)

    def prepare(daemon: Daemon) -> None:
        if told:
            feet = range(len(daemon.feet.sensors))
            daemon.feet.sensors = [_Told(emulator.sensors.feet, foot) for foot in feet]

    outcome = lockstep.walk(emulator, bundle, operator, lambda _: None, prepare=prepare)
    found = metrics.summary(outcome, bundle.contract.gait, bundle.robot)
    return found, outcome.report.feet.doubts


def markdown(results: Sequence[FeetResult]) -> str:
    """A row a case, a column a gait: adherence learnt and, where it differs, told."""
    gaits = list(dict.fromkeys(result.gait for result in results))
    lines = [
        f"| foot sensors | {' | '.join(gaits)} | named |",
        "|---" * (len(gaits) + 2) + "|",
    ]
    for case in dict.fromkeys(result.case for result in results):
        row = [result for result in results if result.case == case]
        named = sum(len(result.doubts) for result in row)
        lines.append(f"| {case} | {' | '.join(map(entry, row))} | {named or '-'} |")
    return "\n".join(lines) + "\n"


def entry(result: FeetResult) -> str:
    """One walk in a few signs."""
    if result.fault or result.falls:
        return f"**{result.fault or 'fell'}**"
    learnt, told = f"{result.learnt:.2f}", f"{result.told:.2f}"
    text = learnt if learnt == told else f"{learnt} ({told})"
    return text if result.as_expected else f"**{text}**"
