"""Figures of made-up runs whose answers are known."""

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from rmll_hil.robot.emulator import TRUTH
from rmll_hil.runs.metrics import summary
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.recording.telemetry import TelemetryRow
from rmll_onboard.state.reports import FeetReport, PacketReport, RunReport
from rmll_robots import A1

SECOND = 1_000_000_000
START, END = 4 * SECOND, 14 * SECOND


REPORT = RunReport(
    gait="trot",
    walking_start_ns=None,
    walking_end_ns=None,
    policy_steps=501,
    transitions=50,
    allowed=55.6,
    adherence=0.9,
    off_spec_contact=0.1,
    fault=None,
    fault_name=None,
    warnings=(),
    stuck_walks=0,
    feet=FeetReport(("torque",) * 4, gain=(), bias=(), doubts={}),
    refused={},
    tick_us=None,
    wake_us=None,
    rss_mb=None,
    timekeeping=None,
    packets=PacketReport(sent=1, received=1, rejected=0, lost=0),
    record=None,
)


def row(t_ns: int, mode: str) -> TelemetryRow:
    return TelemetryRow(t_ns, mode, "", 6, 0, 1, 1, 0, "q0", 0, 0, 0, vx=0.5, wz=0.2, frequency=9.0)


def walk(fault: str | None = None, walked: bool = True) -> Outcome:
    """Ten seconds at 0.4 m/s and 0.2 rad/s with 50 W, ordered 0.5 m/s and 0.2 rad/s."""
    truth = np.zeros(4000, TRUTH)
    seconds = np.arange(4000) * 0.005
    truth["time_ns"] = (seconds * SECOND).astype(np.int64)
    truth["position"][:, 0] = 0.4 * seconds
    truth["velocity"][:, 0] = 0.4
    truth["yaw_rate"] = 0.2
    truth["energy"] = 50 * seconds
    log = [row(t, "walking") for t in range(START, END + 1, SECOND // 50)]
    walking = (START, END) if walked else (None, None)
    report = replace(REPORT, walking_start_ns=walking[0], walking_end_ns=walking[1], fault=fault)
    return Outcome(report, log, truth, 1.0)


def ground(outcome: Outcome, start: float, end: float) -> None:
    seconds = outcome.truth["time_ns"] / SECOND
    outcome.truth["grounded"] |= (seconds >= start) & (seconds < end)


def test_a_steady_walk() -> None:
    figures = summary(walk(), "trot", A1)
    assert figures.gait == "trot"
    assert figures.seconds == 10
    assert figures.vx_error == pytest.approx(0.1)
    assert figures.wz_error == pytest.approx(0.0)
    assert figures.distance == pytest.approx(0.4 * 10)
    assert figures.energy_per_metre == pytest.approx(50 / 0.4)
    assert figures.cost_of_transport == pytest.approx(50 / 0.4 / (12.453 * 9.81), rel=1e-3)
    assert (figures.falls, figures.adherence, figures.off_spec_contact) == (0, 0.9, 0.1)


def test_the_first_second_is_not_judged() -> None:
    outcome = walk()
    early = outcome.truth["time_ns"] < START + SECOND
    outcome.truth["velocity"][early, 0] = -9.0
    assert summary(outcome, "trot", A1).vx_error == pytest.approx(0.1)


def test_errors_follow_a_command_that_changes() -> None:
    outcome = walk()
    log = [replace(r, vx=-0.1) if r.t_ns >= 9 * SECOND else r for r in outcome.log]
    outcome = dataclasses.replace(outcome, log=log)
    # 4 of 9 judged seconds at 0.1 m/s off, 5 at 0.5 m/s
    assert summary(outcome, "trot", A1).vx_error == pytest.approx((0.4 + 2.5) / 9, rel=0.01)


def test_a_walk_that_ended_by_itself_is_stuck() -> None:
    outcome = walk()
    assert not summary(outcome, "trot", A1).stuck
    stuck = dataclasses.replace(outcome, report=replace(outcome.report, stuck_walks=1))
    assert summary(stuck, "trot", A1).stuck


@pytest.mark.parametrize("fault", [None, "tilted while it sat down"])
def test_falls_are_counted_while_walking_only(fault: str | None) -> None:
    outcome = walk(fault)
    log = [*outcome.log, row(END + SECOND, "sitting_down")]
    outcome = dataclasses.replace(outcome, log=log)
    for start, end in [(0.0, 1.0), (6.0, 7.0), (8.0, 8.1), (15.0, 20.0)]:
        ground(outcome, start, end)
    assert summary(outcome, "trot", A1).falls == 2


def test_a_fall_after_a_fault_counts() -> None:
    outcome = walk(fault="tilted")
    ground(outcome, 15.0, 20.0)
    assert summary(outcome, "trot", A1).falls == 1


def test_a_robot_that_never_walked_has_no_figures() -> None:
    figures = summary(walk(fault="no state", walked=False), "trot", A1)
    assert figures.seconds == 0
    assert figures.fault == "no state"
    for name in ("vx_error", "wz_error", "energy_per_metre", "cost_of_transport"):
        assert getattr(figures, name) is None


def test_swaying_on_the_spot_is_not_walking() -> None:
    outcome = walk()
    outcome.truth["position"][:] = 0
    assert summary(outcome, "trot", A1).energy_per_metre is None
