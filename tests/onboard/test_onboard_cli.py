"""``rmll-onboard`` as a process, on a robot without physics behind a real socket."""

import csv
import json
import signal
import socket
import subprocess
import sys
import threading
import time

import msgspec
import pytest
import yaml

from rmll_onboard import a1_wire
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
    settings.write_text(yaml.safe_dump(msgspec.to_builtins(brisk)))

    def run(*flags: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [
                *(sys.executable, "-m", "rmll_onboard.cli"),
                *("--policy", str(bundle_path), "--settings", str(settings), *flags),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return run


def test_it_walks_over_udp_and_reports(start, served, tmp_path):
    robot, address = served
    log = tmp_path / "walk.csv"
    flags = ("--robot-address", address, *BY_FLAGS, "--seconds", "1", "--log", str(log), "--json")
    process = start(*flags)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (0, "")
    report = json.loads(out)
    assert report["fault"] is None
    assert 45 <= report["policy_steps"] <= 52
    assert report["transitions"] > 0
    assert report["packets"]["sent"] > 300
    assert report["packets"]["rejected"] == 0
    assert set(report["tick_us"]) == set(report["wake_us"]) == {"p50", "p99", "p999", "max"}
    assert report["rss_mb"] > 1
    assert robot.damped
    with log.open() as file:
        assert sum(row["mode"] == "walking" for row in csv.DictReader(file)) > 40


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_signal_sits_the_robot_down(start, served, number, code):
    robot, address = served
    process = start("--robot-address", address, *BY_FLAGS, "--json")
    wait_until_walking(robot)
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (code, "")
    assert json.loads(out)["fault"] is None
    assert robot.damped
    assert abs(robot.state.q[1] - 1.36) < 0.05  # folded, not dropped


def test_a_fault_is_reported_and_told(start, served):
    robot, address = served
    process = start("--robot-address", address, *BY_FLAGS, "--json")
    wait_until_walking(robot)
    robot.state.quaternion[:] = [0, 1, 0, 0]
    out, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert err.startswith("rmll-onboard: tilted")
    assert err.count("\n") == 1
    assert json.loads(out)["fault"].startswith("tilted")
    assert robot.damped


def test_a_robot_that_does_not_answer(start):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board:
        board.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{board.getsockname()[1]}"
        process = start("--robot-address", address, *BY_FLAGS)
        _, err = process.communicate(timeout=30)
        assert process.returncode == 1
        assert err == f"rmll-onboard: no answer from the robot at {address} in 0.3 s\n"
        board.settimeout(1)
        command = a1_wire.decode_command(board.recv(2048))
        assert not command.kp.any()
        assert (command.kd > 0).all()


def test_a_busy_port_is_named(start, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        busy = other.getsockname()[1]
        settings = tmp_path / "busy.yaml"
        settings.write_text(f"link: {{local_port: {busy}}}")
        process = start("--settings", str(settings), *BY_FLAGS)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert err == f"rmll-onboard: UDP port {busy} is in use\n"


def test_check_tells_what_is_in_the_bundle(start):
    process = start("--check", "--json")
    out, err = process.communicate(timeout=30)
    assert (process.returncode, err) == (0, "")
    contents = json.loads(out)
    assert contents["gait"] == "trot"
    assert contents["trace_steps"] == 40
    out, _ = start("--check").communicate(timeout=30)
    assert "trot" in out


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--vx", "3"), "--vx 3: this gait was trained for -1 to 1"),
        (("--vx", "nan"), "--vx nan"),
        (("--frequency", "5"), "--frequency 5: this gait was trained for 6 to 12"),
        (("--seconds", "3"), "--seconds needs one of --vx, --wz, --frequency"),
        (("--vx", "0", "--seconds", "-1"), "--seconds -1: expected more than 0"),
        (("--vx", "0", "--robot-address", "robot"), "expected host:port"),
        (("--policy", "/nowhere.onnx"), "/nowhere.onnx: No such file or directory"),
    ],
)
def test_wrong_flags_are_told_in_a_line(start, flags, words):
    process = start(*flags)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 2
    assert words in err
    assert err.count("\n") == 1


def wait_until_walking(robot) -> None:
    deadline = time.monotonic() + 20
    while robot.last is None or robot.last.kp[0] != A1.kp:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.1)
