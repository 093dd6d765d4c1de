"""What the benchmarks of the robot's side share: a bundle, a recorded walk, a wire, a printer."""

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.runs import lockstep
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.interface.transport import UdpTransport
from rmll_onboard.recording.telemetry import Tick

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
SECONDS = 20.0
"""Of walking in the recorded ticks"""


@pytest.fixture(scope="session")
def trot() -> Path:
    return TROT


@pytest.fixture(scope="session")
def bundle(trot: Path) -> Bundle:
    return load_bundle(trot)


@pytest.fixture(scope="session")
def new_operator(bundle: Bundle) -> Callable[[], FlagOperator]:
    return lambda: FlagOperator(bundle.table.commands, vx=0.5, seconds=SECONDS)


@pytest.fixture(scope="session")
def walk(bundle: Bundle, new_operator: Callable[[], FlagOperator]) -> list[Tick]:
    """Every tick of a walk with physics, from lying to lying."""
    ticks: list[Tick] = []
    emulator = Emulator(EmulatorSettings(), robot=bundle.robot)
    lockstep.walk(emulator, bundle, new_operator(), lambda seconds: None, ticks.append)
    return ticks


@pytest.fixture
def wire() -> Iterator[tuple[socket.socket, UdpTransport]]:
    """The robot's end of UDP on loopback, and ours."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind(("127.0.0.1", 0))
        with closing(UdpTransport(f"127.0.0.1:{robot.getsockname()[1]}")) as link:
            link.send(b"hello")
            _, ours = robot.recvfrom(100)
            robot.connect(ours)
            yield robot, link


@pytest.fixture
def emulated() -> Callable:
    """Starts an emulated robot that answers each command; gives its address."""

    @contextmanager
    def start() -> Iterator[str]:
        flags = ("serve", "--port", "0", "--reply", "echo")
        command = [sys.executable, "-m", "rmll_hil.cli", *flags]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout
                yield process.stdout.readline().split()[-1]
            finally:
                process.terminate()

    return start


@pytest.fixture
def tell(benchmark) -> Callable[[str, Sequence[float]], float]:
    """Prints p50 and p99 of durations [us], keeps them with the benchmark, returns the p50."""

    def tell(name: str, durations: Sequence[float]) -> float:
        p50, p99 = np.percentile(durations, [50, 99]).tolist()
        benchmark.extra_info |= {f"{name} p50": round(p50, 1), f"{name} p99": round(p99, 1)}
        print(f"\n{name:44} p50 {p50:8.1f} us   p99 {p99:8.1f} us", end="")
        return p50

    return tell
