"""The fault table in virtual time; over UDP and in real time: ``rmll-hil faults --realtime``."""

import dataclasses
import os
import signal
import time
from pathlib import Path

import pytest

from rmll_common.errors import Failure, InputError
from rmll_hil.faults import fault_command, fault_realtime, fault_trial, fault_virtual
from rmll_hil.faults.empty_loop import EmptyLoop
from rmll_hil.faults.fault_rows import ROWS, FaultRow, Reaction
from rmll_hil.faults.fault_table import FaultResult, markdown, provoke, provoke_once
from rmll_hil.faults.fault_trial import FaultTrial
from rmll_onboard.runtime import loop
from rmll_onboard.safety.faults import Fault
from rmll_robots import A1

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


def row(name: str, **changes: object) -> FaultRow:
    return dataclasses.replace(next(row for row in ROWS if row.name == name), **changes)


def once(row: FaultRow, realtime: bool = False) -> FaultResult:
    return provoke_once(row, 0, TROT, A1, realtime)


@pytest.mark.parametrize("name", [row.name for row in ROWS])
def test_fault(name: str) -> None:
    result = once(row(name))
    assert result.reaction == result.row.reaction, result.told
    assert result.row.words in result.told
    assert (result.milliseconds is None) == (result.reaction in (Reaction.WALKS, Reaction.REFUSES))


def test_nothing_depends_on_the_machine() -> None:
    """The same in this process and in another one; another seed is another walk."""
    pushed = row("pushed_over")
    ((first, other),) = provoke([pushed], TROT, times=2)
    assert first == once(pushed)
    assert (first.as_expected, other.as_expected) == (True, True)
    assert first.told != other.told


@pytest.mark.parametrize("name", ["flipped_imu", "silent_board", "joint_speed"])
def test_a_damped_robot_sinks_down(name: str) -> None:
    trial = FaultTrial(row(name), A1, 0)
    fault_virtual.run(row(name), trial, TROT)
    trial.advance(2000, 0)
    assert trial.truth()["position"][-1, 2] < 0.2


def test_a_signal_that_is_not_handled_ends_the_daemon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "_STOP_SIGNALS", (signal.SIGINT, signal.SIGTERM))
    result = once(row("terminal_closed"))
    assert (result.reaction, result.as_expected) == (Reaction.BRAKES, False)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_the_fault_waits_until_the_robot_has_walked(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the remote too, whose buttons are held for as long as it takes."""
    slow = fault_trial.MOTION | {"rise": 2.0}
    for module in (fault_trial, fault_virtual):
        monkeypatch.setattr(module, "MOTION", slow)
    stop = row("emergency_stop")
    trial = FaultTrial(stop, A1, 0)
    reaction, after_ms, told = fault_virtual.run(stop, trial, TROT)
    assert trial.begin_ms is not None and trial.begin_ms > 3500
    assert (reaction, told) == (Reaction.DAMPS, "emergency_stop: emergency stop on the remote")
    assert after_ms is not None and after_ms <= 10


def test_a_robot_that_never_stands_up_is_told() -> None:
    silent = {"fault": "network", "direction": "from_robot", "loss": 1.0}
    result = once(row("silent_board", plan=(silent,)))
    assert (result.reaction, result.as_expected) == (Reaction.REFUSES, False)
    assert "no answer from the robot" in result.told


def test_a_row_in_real_time() -> None:
    """With all processes; whether the machine had time for them is part of the answer."""
    result = once(row("ctrl_c"), realtime=True)
    assert result.as_expected or result.reaction is Reaction.NOT_JUDGED, result
    assert (result.milliseconds is not None) == result.as_expected


@pytest.mark.parametrize(
    ("seen", "loop_ms", "robot_ms", "reaction"),
    [
        ((Reaction.SITS, 300, ""), 50.0, 50.0, Reaction.SITS),
        ((Reaction.DAMPS, 52, "no state"), 9.0, 9.0, Reaction.DAMPS),
        ((Reaction.DAMPS, 52, "no state"), 11.0, 0.0, Reaction.NOT_JUDGED),
        ((Reaction.DAMPS, 52, "no state"), 0.0, 11.0, Reaction.NOT_JUDGED),
    ],
)
def test_only_a_wrong_reaction_is_put_down_to_a_busy_machine(
    seen: tuple[Reaction, int | None, str], loop_ms: float, robot_ms: float, reaction: Reaction
) -> None:
    judged = fault_realtime.judged(row("ctrl_c"), seen, loop_ms, robot_ms)
    assert judged[0] is reaction
    if reaction is Reaction.NOT_JUDGED:
        late = f"an empty loop was late by {loop_ms:.0f} ms, the robot by {robot_ms:.0f} ms"
        assert judged[1:] == (None, f"{late}; damps: no state")


def test_an_empty_loop_notices_what_keeps_it_from_running() -> None:
    with EmptyLoop() as beside:
        os.kill(beside.pid, signal.SIGSTOP)
        time.sleep(0.1)
        os.kill(beside.pid, signal.SIGCONT)
    assert beside.late_ms > 50


def test_another_reaction_or_other_words_are_not_as_expected() -> None:
    fine = FaultResult(
        row("flipped_imu"), Reaction.DAMPS, 4, "tilted: roll 3.10 rad, pitch 0.00 rad"
    )
    assert fine.as_expected
    assert not dataclasses.replace(fine, reaction=Reaction.WALKS).as_expected
    assert not dataclasses.replace(fine, told="no state from the robot").as_expected


def test_the_page_tells_how_often_it_was_as_it_should() -> None:
    fine = FaultResult(
        row("flipped_imu"), Reaction.DAMPS, 4, "tilted: roll 3.10 rad, pitch 0.00 rad"
    )
    late = dataclasses.replace(fine, milliseconds=6)
    wrong = dataclasses.replace(fine, told="no state from the robot")
    page = markdown([[fine, late]], TROT, realtime=False)
    tilted = "tilted: roll 3.10 rad, pitch 0.00 rad"
    assert f"| 4-6 | damps | 2/2 | {tilted} | `flipped_imu` |" in page
    assert "in virtual time" in page and "--times 2 --out" in page
    assert all(f"| `{fault}` | {fault.meaning} | " in page for fault in Fault)
    assert "is too hot | damps when it shall stand up | damps | damps |" in page
    page = markdown([[fine, wrong]], TROT, realtime=True)
    assert "| 4 | damps | 1/2 | no state from the robot | `flipped_imu` |" in page
    assert "over UDP" in page and "--realtime --times 2 --out" in page


@pytest.mark.parametrize(
    ("reactions", "words"),
    [
        ((Reaction.DAMPS, Reaction.NOT_JUDGED), "^not judged, as the machine was too busy: killed"),
        ((Reaction.WALKS, Reaction.NOT_JUDGED), "^not as expected: killed$"),
    ],
)
def test_the_command_fails_unless_all_is_as_expected(
    reactions: tuple[Reaction, ...], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = row("killed", reaction=Reaction.DAMPS)
    results = [FaultResult(killed, reaction, None, "") for reaction in reactions]
    monkeypatch.setattr(fault_command, "provoke", lambda *_: iter([results]))
    with pytest.raises(Failure, match=words):
        fault_command.faults(TROT, ("killed",), False, 2, 1, None, False)


@pytest.mark.parametrize(
    ("only", "times", "jobs", "words"),
    [
        (("earthquake",), 1, 1, "--only earthquake: unknown fault; known: pushed_over, "),
        ((), 1, 0, "--jobs 0: expected 1 to 16"),
        ((), 0, 1, "--times 0: expected 1 to 1000"),
    ],
)
def test_wrong_flags_are_refused(only: tuple[str, ...], times: int, jobs: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        fault_command.faults(TROT, only, False, times, jobs, None, False)
