"""``rmll-onboard`` as a process, on a robot without physics behind a real socket."""

import fcntl
import json
import os
import pty
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
from contextlib import suppress
from typing import Any

import msgspec
import pytest
import yaml

from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.settings.runtime_settings import LinkSettings
from rmll_robots import A1

BY_FLAGS = ("--vx", "0.5", "--frequency", "8")


@pytest.fixture
def served(robot):
    """The robot, answering every command from a thread; and its address."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board:
        board.bind(("127.0.0.1", 0))
        board.settimeout(0.1)
        over = threading.Event()

        def serve():
            while not over.is_set():
                try:
                    datagram, sender = board.recvfrom(2048)
                    board.sendto(robot.answer(datagram), sender)
                except TimeoutError:
                    continue

        thread = threading.Thread(target=serve)
        thread.start()
        yield robot, f"127.0.0.1:{board.getsockname()[1]}"
        over.set()
        thread.join()


@pytest.fixture
def start(bundle_path, brisk, tmp_path):
    """Starts the command on the test's bundle and settings."""
    settings = tmp_path / "settings.yaml"
    # a busy machine is late, which is no fault of the robot's
    safety = msgspec.structs.replace(brisk.safety, stale_ms=1000, frozen_ms=5000)
    link = LinkSettings(startup_timeout=30)
    patient = msgspec.structs.replace(brisk, safety=safety, link=link)
    settings.write_text(yaml.safe_dump(msgspec.to_builtins(patient)))

    started: list[subprocess.Popen[str]] = []

    def run(*flags: str, **process: Any) -> subprocess.Popen[str]:
        command = [
            *(sys.executable, "-m", "rmll_onboard.cli"),
            *("--policy", str(bundle_path), "--settings", str(settings), *flags),
        ]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        started.append(subprocess.Popen(command, text=True, **pipes | process))
        return started[-1]

    yield run
    for one in started:  # of a test that failed
        one.kill()


def test_it_walks_over_udp_and_reports(start, served, tmp_path):
    robot, address = served
    log = tmp_path / "walk.mcap"
    flags = (*BY_FLAGS, "--seconds", "1", "--record", str(log), "--json")
    process = start("--robot-address", address, *flags)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, ""), err
    report = json.loads(out)
    assert report["fault"] is None
    missed = report["timekeeping"]["missed"]  # four ticks a policy step
    assert report["policy_steps"] + missed / 4 >= 45
    assert 0 < report["policy_steps"] <= 52
    assert report["transitions"] > 0 or missed > 50
    assert report["packets"]["sent"] + missed > 300
    assert report["packets"]["rejected"] == 0
    assert set(report["tick_us"]) == set(report["wake_us"]) == {"p50", "p99", "p999", "max"}
    assert report["rss_mb"] > 1
    assert robot.damped
    assert report["record"]["trouble"] is None
    assert report["record"]["dropped"] == 0
    ticks = list(FlightLog(log).ticks())
    assert [tick.number for tick in ticks] == list(range(report["record"]["ticks"]))
    walking = sum(row.mode == "walking" for row in FlightLog(log).rows())
    assert walking >= report["policy_steps"] > 0


def test_a_program_leads(start, served, tmp_path):
    robot, address = served
    path = tmp_path / "commands"
    process = start("--robot-address", address, "--commands", str(path), "--json")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as program:

        def ask_until(request: str, kp: float) -> None:
            deadline = time.monotonic() + 100
            while robot.last is None or robot.last.kp[0] != kp:
                assert time.monotonic() < deadline and process.poll() is None
                with suppress(FileNotFoundError):  # it has not got so far yet
                    program.sendto(b'{"request": "%s", "vx": 0.5}' % request.encode(), str(path))
                time.sleep(0.02)

        ask_until("stand", A1.stand_kp)
        ask_until("walk", A1.kp)
        ask_until("stand", A1.stand_kp)
        ask_until("sit", 0.0)
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, ""), err
    report = json.loads(out)
    assert report["fault"] is None
    assert report["policy_steps"] > 0
    assert not path.exists()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_sits_the_robot_down(start, served, number, code):
    robot, address = served
    process = start("--robot-address", address, *BY_FLAGS, "--json")
    wait_until_walking(robot)
    process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (code, "")
    assert json.loads(out)["fault"] is None
    assert robot.damped
    assert abs(robot.state.q[1] - 1.36) < 0.05  # folded, not dropped


def test_a_closed_terminal_sits_the_robot_down(start, served):
    robot, address = served
    ours, theirs = pty.openpty()

    def in_a_terminal():
        os.setsid()
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    flags = ("--robot-address", address, *BY_FLAGS)
    process = start(*flags, stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=in_a_terminal)
    os.close(theirs)
    wait_until_walking(robot)
    os.close(ours)
    process.wait(timeout=120)
    assert robot.damped
    assert abs(robot.state.q[1] - 1.36) < 0.05  # folded, not dropped


def test_a_fault_is_reported_and_told(start, served):
    robot, address = served
    process = start("--robot-address", address, *BY_FLAGS, "--json")
    wait_until_walking(robot)
    robot.orientation[:] = [0, 1, 0, 0]
    out, err = process.communicate(timeout=120)
    assert process.returncode == 1
    assert err.startswith("rmll-onboard: tilted")
    assert err.count("\n") == 1
    assert json.loads(out)["fault"].startswith("tilted")
    assert robot.damped


def test_a_robot_that_does_not_answer(start, tmp_path):
    settings = tmp_path / "hasty.yaml"
    settings.write_text("link: {startup_timeout: 0.3}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board:
        board.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{board.getsockname()[1]}"
        process = start("--settings", str(settings), "--robot-address", address, *BY_FLAGS)
        _, err = process.communicate(timeout=120)
        assert process.returncode == 1
        assert err == f"rmll-onboard: no answer from the robot at {address} in 0.3 s\n"
        board.settimeout(1)
        command = A1BoardPackets().decode_command(board.recv(2048))
        assert not command.kp.any()
        assert (command.kd > 0).all()


def test_a_busy_port_is_named(start, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        busy = other.getsockname()[1]
        settings = tmp_path / "busy.yaml"
        settings.write_text(f"link: {{local_port: {busy}}}")
        process = start("--settings", str(settings), *BY_FLAGS)
        _, err = process.communicate(timeout=120)
    assert process.returncode == 1
    assert err == f"rmll-onboard: UDP port {busy} is in use\n"


def test_check_tells_what_is_in_the_bundle(start):
    process = start("--check", "--json")
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, ""), err
    contents = json.loads(out)
    assert contents["gait"] == "trot"
    assert contents["trace_steps"] == 40
    assert contents["deadband"] == 0.08  # of the settings, for whoever leads by sticks


def test_check_shows_how_a_shipped_policy_came_to_be_on_one_screen(start):
    out, err = start("--check", "--policy", "trot").communicate(timeout=120)
    assert err == ""
    bundle, *lines = out.splitlines()
    assert bundle.endswith("policies/trot.onnx")
    assert max(map(len, lines)) <= 80 and len(lines) < 50
    assert "gait          trot" in lines
    assert "  settings            (--json tells them)" in lines
    assert any(line.startswith("    adherence  ") for line in lines)
    out, _ = start("--check", "--policy", "trot", "--json").communicate(timeout=120)
    assert json.loads(out)["provenance"]["settings"]["learner"]["gamma"] == 0.99


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--vx", "3"), "--vx 3: this gait was trained for -1 to 1"),
        (("--vx", "nan"), "--vx nan"),
        (("--frequency", "5"), "--frequency 5: this gait was trained for 6 to 12"),
        (("--seconds", "3"), "--seconds needs one of --vx, --wz, --frequency"),
        (("--vx", "0", "--seconds", "-1"), "--seconds -1: expected 0.02 to 1000000"),
        (("--frequency", "12", "6"), "--frequency with several values needs --seconds"),
        (("--vx", "0", "--gamepad", "auto"), "--vx and --gamepad: one can lead, not both"),
        (("--gamepad", "auto", "--commands", "x"), "--gamepad and --commands: one can lead"),
        (("--commands", "/nowhere/socket"), "--commands /nowhere/socket: "),
        (("--vx", "0", "--robot-address", "robot"), "expected host:port"),
        (("--policy", "/nowhere.onnx"), "/nowhere.onnx: No such file or directory"),
    ],
)
def test_wrong_flags_are_told_in_a_line(start, flags, words):
    process = start(*flags)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 2
    assert words in err
    assert err.count("\n") == 1


def test_the_service_manager_hears_of_a_walk_and_people_how_well_it_kept_time(
    start, served, tmp_path, monkeypatch
):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "100000000")
        flags = (*BY_FLAGS, "--seconds", "0.2", "--report")
        process = start("--robot-address", served[1], *flags)
        out, err = process.communicate(timeout=120)
        assert (process.returncode, err) == (0, ""), err
        words = [manager.recv(100).decode() for _ in range(3)]
        assert words == ["READY=1", "WATCHDOG=1", "STOPPING=1"]
    rows = [line.split()[:2] for line in out.splitlines()]
    assert ["policy", "tick"] in rows
    assert ["missed", "deadlines"] in rows


def wait_until_walking(robot) -> None:
    deadline = time.monotonic() + 100
    while robot.last is None or robot.last.kp[0] != A1.kp:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.1)
