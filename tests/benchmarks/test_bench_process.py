"""From the start of the process to its first command."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest


def test_start_to_first_command(benchmark, tell, trot: Path) -> None:
    """Interpreter, libraries, the bundle checked and its golden trace replayed."""
    command = [sys.executable, "-m", "rmll_onboard.cli", "--policy", trot]
    processes: list[subprocess.Popen] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind(("127.0.0.1", 0))
        robot.settimeout(60.0)
        address = f"127.0.0.1:{robot.getsockname()[1]}"

        def start() -> None:
            processes.append(
                subprocess.Popen([*command, "--robot-address", address], stdout=subprocess.DEVNULL)
            )
            robot.recv(2048)

        def end() -> None:
            """Of the one before: no datagram of it may be taken for the next one's."""
            for process in processes:
                process.kill()
                process.wait()
            processes.clear()
            robot.setblocking(False)
            with pytest.raises(BlockingIOError):
                while True:
                    robot.recv(2048)
            robot.settimeout(60.0)

        benchmark.pedantic(start, setup=end, rounds=10)
        end()
    tell("start to first command", [seconds * 1e6 for seconds in benchmark.stats.stats.data])
