"""The command itself, with the processes it starts."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from rmll_common.errors import Failure, InputError
from rmll_hil.robot.emulator import EmulatorSettings
from rmll_hil.runs import realtime_run
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.settings.runtime_settings import Motion

FIGURES = [
    *("gait", "seconds", "adherence", "transitions", "off_spec_contact", "vx_error", "wz_error"),
    *("falls", "distance", "energy_per_metre", "cost_of_transport", "realtime_factor"),
    *("tick_us", "wake_us", "rss_mb", "packets"),
]
MEASURED = [
    *("t", "advanced", "off_spec", "vx", "wz", "energy"),
    *("true_x", "true_y", "true_vx", "true_wz"),
]
REPORT = (
    '{"gait":"trot","walking_start_ns":5,"walking_end_ns":7,"policy_steps":11,"transitions":3,'
    '"allowed":3.5,"adherence":0.857,"off_spec_contact":0.2,"fault":null,"fault_name":null,"warnings":["hot"],'
    '"stuck_walks":0,"feet":{"contact_by":["torque","sensor","torque","torque"],'
    '"gain":[null,2.1,null,null],"bias":[null,-3.0,null,null],"doubts":{"FR":"too noisy"}},'
    '"refused":{"late":1},"tick_us":{"p50":1.0,"p99":2.0,"p999":3.0,"max":3.1},"wake_us":null,'
    '"rss_mb":80.5,"timekeeping":{"plain_tick_us":null,"slack_us":{"p50":4.0,"p01":3.0,'
    '"p001":2.0,"min":-1.5},"missed":0,"memory_mb":[80.0,80.5]},"packets":{"sent":500,'
    '"received":490,"rejected":1,"lost":9},"record":{"file":"run.mcap","dropped":0,"ticks":500,'
    '"megabytes":0.3,"trouble":null}}'
)
"""What ``rmll-onboard --json`` has printed ever since"""
TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


def start(*flags: object, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rmll_hil.cli", "run", *map(str, flags)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=cwd, stdout=pipe, stderr=pipe, text=True)


def run(*flags: object, cwd: Path) -> tuple[int, str, str]:
    process = start(*flags, cwd=cwd)
    stdout, stderr = process.communicate(timeout=240)
    return process.returncode, stdout, stderr


def patient(folder: Path) -> tuple[object, ...]:
    """Flags for a policy that stands, and so makes no transitions."""
    (folder / "patient.yaml").write_text("safety: {stuck: 100}")
    return "--settings", "patient.yaml"


def wait_for_children(process: subprocess.Popen[str]) -> list[int]:
    """The emulator and the daemon, in this order."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        process.kill()
        pytest.skip("needs Linux's list of child processes")
    started: list[str] = []
    while len(started) < 2:
        assert process.poll() is None
        started = children.read_text().split()
        time.sleep(0.05)
    return [int(child) for child in started]


def wait_for_ticks(log: Path, count: int) -> None:
    deadline = time.monotonic() + 100
    while time.monotonic() < deadline:
        with suppress(InputError):  # it has not begun
            if sum(1 for _ in FlightLog(log).ticks()) > count:
                return
        time.sleep(0.05)
    raise AssertionError(f"{log} does not get there")


def test_real_time_over_udp(standing: Path, tmp_path: Path, kept_time) -> None:
    flags = ("--policy", standing, "--seconds", 0.7, "--vx", 0, "--json", "--out", "here")
    flags += patient(tmp_path)
    with kept_time():
        code, stdout, stderr = run(*flags, cwd=tmp_path)
        assert code == 0, stderr
        check_the_walk(stdout, tmp_path, standing)


def check_the_walk(stdout: str, tmp_path: Path, standing: Path) -> None:
    figures = json.loads(stdout)
    assert set(FIGURES) <= set(figures)
    assert figures["seconds"] == pytest.approx(0.7, abs=0.1)
    assert (figures["falls"], figures["fault"]) == (0, None)
    assert list(figures["tick_us"]) == list(figures["wake_us"]) == ["p50", "p99", "p999", "max"]
    assert figures["packets"]["received"] > 500
    assert figures["packets"]["rejected"] == 0
    assert json.loads((tmp_path / "here" / "summary.json").read_text()) == figures
    assert (tmp_path / "here" / "contact.png").stat().st_size > 1000
    replayed = subprocess.run(
        [sys.executable, "-m", "rmll_hil.cli", "replay", "here/run.mcap", "--policy", standing],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert replayed.returncode == 0, replayed.stderr
    assert replayed.stdout.endswith(" s, 0 different\n")
    with (tmp_path / "here" / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    walking = [row for row in rows if row["mode"] == "walking"]
    halt = Motion().slow_down  # on the spot, before it sits down
    assert len(walking) == pytest.approx(50 * (0.7 + halt), abs=5)
    # both sides' clocks agree: standing, by the daemon's account and in truth
    assert all(float(row["true_z"]) > 0.25 for row in walking)


def test_lockstep_prints_the_same_twice_and_keeps_old_runs(standing: Path, tmp_path: Path) -> None:
    flags = ("--policy", standing, "--seconds", 1, "--vx", 0, "--lockstep", "--json", "--seed", 3)
    flags += patient(tmp_path)
    (_, first, stderr), (_, again, _) = (run(*flags, cwd=tmp_path) for _ in range(2))
    figures, same = json.loads(first), json.loads(again)
    # the one figure of the machine
    assert f": {figures['realtime_factor']:.2f} x real time\n" in stderr
    assert figures | {"realtime_factor": 0} == same | {"realtime_factor": 0}
    assert figures["seconds"] == 1
    assert len(list((tmp_path / "hil-runs").glob("trot-*/summary.json"))) == 2


def test_a_walk_that_gets_stuck_is_no_success(standing: Path, tmp_path: Path) -> None:
    flags = ("--policy", standing, "--seconds", 2, "--vx", 0, "--frequency", 6, "--lockstep")
    code, stdout, stderr = run(*flags, "--out", "here", cwd=tmp_path)
    assert code == 1
    assert "the gait was stuck" in stdout
    assert "the robot stopped walking by itself: the gait was stuck" in stderr.splitlines()[-1]
    summary = json.loads((tmp_path / "here" / "summary.json").read_text())
    assert (summary["stuck"], summary["fault"], summary["falls"]) == (True, None, 0)
    assert 0.2 < summary["seconds"] < 0.4  # 2 times c_f of 20 ms


def test_a_fault_plan_is_carried_out(standing: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text("- {fault: frozen, at: 4}")
    flags = ("--seconds", 2, "--vx", 0, "--lockstep", "--faults", "plan.yaml", "--json")
    flags += patient(tmp_path)
    code, stdout, stderr = run("--policy", standing, *flags, cwd=tmp_path)
    assert code == 1
    assert json.loads(stdout)["fault"].startswith("no state from the robot for 55 ms")
    assert "the robot went into damping: no state" in stderr


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (("--policy", "none.onnx"), "none.onnx: No such file or directory"),
        (("--vx", 7), "--vx 7: this gait was trained for -1 to 1"),
        (("--frequency", 99), "--frequency 99: this gait was trained for 6 to 12"),
        (("--seed", -1), "--seed -1: expected at least 0"),
        (("--seconds", 0), "--seconds 0: expected 0.02 to 1000000"),
        (("--faults", "none.yaml"), "none.yaml: cannot be read: No such file or directory"),
        (("--out", "."), ". exists already; a run needs a new folder"),
    ],
)
def test_wrong_input_is_one_line(
    flags: tuple, complaint: str, standing: Path, tmp_path: Path
) -> None:
    code, stdout, stderr = run("--policy", standing, *flags, cwd=tmp_path)
    assert (code, stdout, stderr) == (2, "", f"rmll-hil: {complaint}\n")
    assert not list(tmp_path.iterdir())


def test_what_ails_the_daemon_is_passed_on(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^none\.onnx: No such file"):
        realtime_run.walk(
            ["--policy", "none.onnx"], EmulatorSettings(), tmp_path / "run.mcap", lambda _: None
        )


def test_an_interrupted_run_leaves_nothing_behind(standing: Path, tmp_path: Path) -> None:
    process = start("--policy", standing, "--seconds", 60, "--vx", 0, cwd=tmp_path)
    started = wait_for_children(process)
    process.terminate()
    _, stderr = process.communicate(timeout=240)
    assert process.returncode == 130
    assert stderr.endswith("rmll-hil: stopped\n")
    assert not any(Path(f"/proc/{child}").exists() for child in started)
    assert not list((tmp_path / "hil-runs").iterdir())


def test_a_machine_that_is_too_busy_is_told(standing: Path, tmp_path: Path) -> None:
    process = start("--policy", standing, "--seconds", 60, "--vx", 0, "--out", "x", cwd=tmp_path)
    emulator, _ = wait_for_children(process)
    wait_for_ticks(tmp_path / "x" / "run.mcap", 100)  # it is being stood up
    os.kill(emulator, signal.SIGSTOP)  # what a busy machine does to it
    time.sleep(0.3)
    os.kill(emulator, signal.SIGCONT)
    stdout, stderr = process.communicate(timeout=240)
    assert process.returncode == 1
    assert "fault" in stdout and "timekeeping" in stdout
    assert max(map(len, stdout.splitlines())) <= 80
    told = stderr.splitlines()[-1]
    assert told.startswith("rmll-hil: the machine is too busy: of ")
    assert "use --lockstep" in told
    assert "(the robot went into damping: no state from the robot for " in told


@pytest.mark.parametrize(("missed", "lost", "busy"), [(0, 3, False), (2, 9, True), (20, 0, True)])
def test_a_run_that_kept_time_has_its_own_faults(missed: int, lost: int, busy: bool) -> None:
    report = realtime_run.read_report(REPORT)
    assert report.timekeeping
    kept, packets = replace(report.timekeeping, missed=missed), replace(report.packets, lost=lost)
    report = replace(report, timekeeping=kept, packets=packets)
    assert (realtime_run.too_busy(report) is not None) == busy


def test_the_daemons_report_is_the_same_json_again() -> None:
    assert msgspec.json.encode(realtime_run.read_report(REPORT)).decode() == REPORT


@pytest.mark.parametrize(
    "text",
    ["Segmentation fault", "[]", "{}", "[" * 100_000, REPORT[:-1], REPORT.replace("11", '"x"')],
)
def test_a_report_that_is_none_is_told_in_one_line(text: str) -> None:
    with pytest.raises(Failure, match=r"^the daemon's report cannot be read: .*$"):
        realtime_run.read_report(text)


def test_the_figures_are_those_of_the_table_beside_them(tmp_path: Path) -> None:
    flags = ("--policy", TROT, "--seconds", 3, "--wz", 0.3, "--lockstep", "--json", "--out", "x")
    code, stdout, stderr = run(*flags, cwd=tmp_path)
    assert code == 0, stderr
    figures = json.loads(stdout)
    with (tmp_path / "x" / "run.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["mode"] == "walking"]
    walk = {name: np.array([float(row[name]) for row in rows]) for name in MEASURED}
    walk = {name: values[walk["t"] - walk["t"][0] <= 3 + 1e-6] for name, values in walk.items()}
    settled = walk["t"] - walk["t"][0] >= 1
    way = np.hypot(np.diff(walk["true_x"]), np.diff(walk["true_y"])).sum()
    spent = walk["energy"][-1] - walk["energy"][0]
    assert figures["seconds"] == pytest.approx(walk["t"][-1] - walk["t"][0])
    assert figures["distance"] == pytest.approx(way, rel=0.01)
    assert figures["energy_per_metre"] == pytest.approx(spent / way, rel=0.01)
    assert figures["cost_of_transport"] == pytest.approx(spent / way / (12.453 * 9.81), rel=0.01)
    assert figures["transitions"] == walk["advanced"].sum()
    assert figures["off_spec_contact"] == pytest.approx(walk["off_spec"].mean())
    for name in ("vx", "wz"):
        error = np.abs(walk[f"true_{name}"] - walk[name])[settled].mean()
        assert figures[f"{name}_error"] == pytest.approx(error, abs=0.005)
    assert figures["packets"]["sent"] == figures["packets"]["received"] + 101


@pytest.mark.slow
def test_the_shipped_trot_walks_over_udp(tmp_path: Path, kept_time) -> None:
    with kept_time():
        code, stdout, stderr = run(
            "--policy", TROT, "--seconds", 8, "--vx", 0.5, "--json", cwd=tmp_path
        )
        assert code == 0, stderr
        figures = json.loads(stdout)
        assert figures["falls"] == 0
        assert figures["adherence"] >= 0.9
        assert figures["vx_error"] <= 0.15
