"""The command itself, with the processes it starts."""

import csv
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rmll_gaits.errors import InputError
from rmll_hil import realtime
from rmll_hil.emulator import Settings
from rmll_onboard.settings import Motion

FIGURES = [
    *("gait", "seconds", "adherence", "transitions", "off_spec_contact", "vx_error", "wz_error"),
    *("falls", "distance", "energy_per_metre", "cost_of_transport", "realtime_factor"),
    *("tick_us", "wake_us", "rss_mb", "packets"),
]
TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


def start(*flags: object, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rmll_hil.cli", "run", *map(str, flags)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=cwd, stdout=pipe, stderr=pipe, text=True)


def run(*flags: object, cwd: Path) -> tuple[int, str, str]:
    process = start(*flags, cwd=cwd)
    stdout, stderr = process.communicate(timeout=60)
    return process.returncode, stdout, stderr


def test_real_time_over_udp(standing: Path, tmp_path: Path) -> None:
    # shorter than the ten c_f after which a policy that makes no transition has to stand
    flags = ("--policy", standing, "--seconds", 0.7, "--vx", 0, "--json", "--out", "here")
    code, stdout, stderr = run(*flags, cwd=tmp_path)
    assert code == 0, stderr
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
    (_, first, _), (_, again, _) = (run(*flags, cwd=tmp_path) for _ in range(2))
    assert first == again
    assert json.loads(first)["seconds"] == 1
    assert len(list((tmp_path / "hil-runs").glob("trot-*/summary.json"))) == 2


def test_a_fault_plan_is_carried_out(standing: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text("- {fault: frozen, at: 4}")
    flags = ("--seconds", 2, "--vx", 0, "--lockstep", "--faults", "plan.yaml", "--json")
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
        (("--faults", "none.yaml"), "none.yaml: No such file or directory"),
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
        realtime.walk(["--policy", "none.onnx"], Settings(), tmp_path / "run.mcap", lambda _: None)


def test_an_interrupted_run_leaves_nothing_behind(standing: Path, tmp_path: Path) -> None:
    process = start("--policy", standing, "--seconds", 60, "--vx", 0, cwd=tmp_path)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.exists():
        process.kill()
        pytest.skip("needs Linux's list of child processes")
    started: list[str] = []
    while len(started) < 2:
        assert process.poll() is None
        started = children.read_text().split()
        time.sleep(0.05)
    process.terminate()
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == 130
    assert stderr.endswith("rmll-hil: stopped\n")
    assert not any(Path(f"/proc/{child}").exists() for child in started)
    assert not list((tmp_path / "hil-runs").iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not TROT.exists(), reason="policies/trot.onnx is not there")
def test_the_shipped_trot_walks_over_udp(tmp_path: Path) -> None:
    code, stdout, stderr = run(
        "--policy", TROT, "--seconds", 8, "--vx", 0.5, "--json", cwd=tmp_path
    )
    assert code == 0, stderr
    figures = json.loads(stdout)
    assert figures["falls"] == 0
    assert figures["adherence"] >= 0.9
    assert figures["vx_error"] <= 0.15
