"""The figures of a run, as the words of this project define them."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from rmll_hil.runs.outcome import Outcome, at, column, times
from rmll_onboard.state.attitude import GRAVITY
from rmll_onboard.state.modes import Mode
from rmll_onboard.state.reports import PacketReport, Timekeeping, UpperPercentiles
from rmll_robots import Robot

SETTLING_NS = 1_000_000_000
"""The first second of walking does not count for the velocity errors"""

LEAST_DISTANCE = 0.2
"""[m]; on a shorter way a robot has swayed, not walked"""


class SweepPhase(msgspec.Struct, frozen=True):
    """The share of a walk that had one c_f."""

    frequency: float
    """c_f [policy steps]"""
    seconds: float
    transitions: int
    adherence: float


class RunSummary(msgspec.Struct, frozen=True):
    """The figures, in the order of the JSON; None where there is nothing to measure."""

    gait: str
    seconds: float
    """of walking"""
    adherence: float | None
    """Transitions made over transitions that the frequency command allows"""
    transitions: int
    off_spec_contact: float | None
    """Share of policy steps whose label the automaton cannot explain"""
    vx_error: float | None
    """[m/s] mean absolute error of the true velocity in the base frame after the first second"""
    wz_error: float | None
    """[rad/s], the same"""
    falls: int
    """How often the base touched the ground"""
    distance: float
    """[m] on the ground"""
    energy_per_metre: float | None
    """[J/m] sum |torque x speed| dt over the distance"""
    cost_of_transport: float | None
    """That over the weight"""
    fault: str | None
    fault_name: str | None
    stuck: bool
    """The gait waited so long for a contact that the robot stopped by itself"""
    warnings: tuple[str, ...]
    realtime_factor: float
    """The robot's time over the wall's"""
    tick_us: UpperPercentiles | None
    """As in a RunReport, and so are the next ones"""
    wake_us: UpperPercentiles | None
    rss_mb: float | None
    timekeeping: Timekeeping | None
    packets: PacketReport
    phases: tuple[SweepPhase, ...] | msgspec.UnsetType = msgspec.UNSET
    """Of a walk with several c_f alone"""


def summary(outcome: Outcome, gait: str, robot: Robot) -> RunSummary:
    """The figures of one run."""
    report = outcome.report
    start, end = report.walking_start_ns, report.walking_end_ns
    window, seconds, falls = outcome.truth[:0], 0.0, 0
    if start is not None and end is not None:
        window = _between(outcome.truth, start, end)
        seconds, falls = (end - start) / 1e9, _falls(outcome, start, end)
    vx_error, wz_error = _velocity_errors(outcome, window)
    distance = _distance(window)
    energy = _energy_per_metre(window, distance)
    return RunSummary(
        gait=gait,
        seconds=seconds,
        adherence=report.adherence,
        transitions=report.transitions,
        off_spec_contact=report.off_spec_contact,
        vx_error=vx_error,
        wz_error=wz_error,
        falls=falls,
        distance=distance,
        energy_per_metre=energy,
        cost_of_transport=cost_of_transport(energy, robot),
        fault=report.fault,
        fault_name=report.fault_name,
        stuck=report.stuck_walks > 0,
        warnings=report.warnings,
        realtime_factor=outcome.realtime_factor,
        tick_us=report.tick_us,
        wake_us=report.wake_us,
        rss_mb=report.rss_mb,
        timekeeping=report.timekeeping,
        packets=report.packets,
    )


def cost_of_transport(energy_per_metre: float | None, robot: Robot) -> float | None:
    """Energy per metre [J/m] over the robot's weight; None stays None."""
    return None if energy_per_metre is None else energy_per_metre / (robot.mass * GRAVITY)


def _between(truth: NDArray[np.void], start: int, end: int) -> NDArray[np.void]:
    return truth[(truth["time_ns"] >= start) & (truth["time_ns"] <= end)]


def _velocity_errors(
    outcome: Outcome, window: NDArray[np.void]
) -> tuple[float | None, float | None]:
    if not len(window):
        return None, None
    settled = window[window["time_ns"] >= window["time_ns"][0] + SETTLING_NS]
    if not len(settled):
        return None, None
    command = column(outcome.log, "vx", "wz")[at(times(outcome.log), settled["time_ns"])]
    vx_error = np.abs(settled["velocity"][:, 0] - command[:, 0]).mean()
    wz_error = np.abs(settled["yaw_rate"] - command[:, 1]).mean()
    return float(vx_error), float(wz_error)


def _falls(outcome: Outcome, start: int, end: int) -> int:
    """Touches of the ground from the first step on, until the robot sits down on purpose.

    A fault while walking ends in damping, without sitting down, so what follows it counts.
    """
    truth = outcome.truth
    sat_down = any(row.mode == Mode.SITTING_DOWN for row in outcome.log)
    last = end if sat_down else truth["time_ns"][-1]
    grounded = _between(truth, start, last)["grounded"]
    return int((grounded[1:] & ~grounded[:-1]).sum())


def _distance(window: NDArray[np.void]) -> float:
    steps = np.diff(window["position"][:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def _energy_per_metre(window: NDArray[np.void], distance: float) -> float | None:
    if distance < LEAST_DISTANCE:
        return None
    return float(window["energy"][-1] - window["energy"][0]) / distance
