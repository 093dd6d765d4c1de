"""Emulator and daemon as two processes that talk UDP over loopback, in real time."""

import dataclasses
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from rmll_gaits.errors import Failure, InputError
from rmll_hil.emulator import Settings
from rmll_hil.outcome import AFTERMATH, Outcome, read_log

PATIENCE = 8.0
"""[s] for a process to end by itself; sitting down takes about three"""


def walk(
    daemon_flags: list[str],
    settings: Settings,
    scratch: Path,
    progress: Callable[[float], None],
) -> Outcome:
    """Start both, wait until the daemon has finished, and end the emulator.

    Args:
        daemon_flags: of ``rmll-onboard``, without the robot's address.
        scratch: a folder for both sides' logs.
        progress: hears the seconds since the daemon's start.

    Raises InputError or Failure, whichever the daemon ended with, if it has nothing to report.
    """
    truth_path, log_path = scratch / "truth.npz", scratch / "onboard.csv"
    robot_flags = [
        text
        for name, value in dataclasses.asdict(settings).items()
        for text in (f"--{name.replace('_', '-')}", str(value))
    ]
    serve = ["rmll_hil.cli", "serve", "--port", "0", "--log", str(truth_path), *robot_flags]
    onboard = ["rmll_onboard.cli", *daemon_flags, "--log", str(log_path), "--json"]
    with _interruptible(), _process(serve) as emulator:
        with _process([*onboard, "--robot-address", _address(emulator)]) as daemon:
            began = time.monotonic()
            # an emulator that died is noticed by the daemon, as on the robot
            while daemon.poll() is None:
                progress(time.monotonic() - began)
                time.sleep(0.1)
            report = _report(daemon)
        if report["fault"]:
            time.sleep(AFTERMATH)
        emulator.terminate()
        _, complaint = emulator.communicate(timeout=PATIENCE)
        if emulator.returncode:
            raise Failure(
                f"the emulator ended with exit code {emulator.returncode}: {_reason(complaint)}"
            )
    with np.load(truth_path) as saved:
        truth, counters = saved["truth"], json.loads(str(saved["counters"]))
    return Outcome(report, read_log(log_path), truth, counters["realtime_factor"])


@contextmanager
def _interruptible() -> Iterator[None]:
    """Whoever ends us, the other processes have to be ended too, so it must not be at once."""
    ends = (signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, signal.default_int_handler) for number in ends]
    try:
        yield
    finally:
        for number, handler in zip(ends, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def _process(module_and_flags: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A Python module as a process that does not outlive the block.

    It has a session of its own: Ctrl-C reaches it as our SIGTERM, so that the robot can sit down
    while its emulator is still there.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", *module_and_flags],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(PATIENCE)
            finally:
                process.kill()


def _address(emulator: subprocess.Popen[str]) -> str:
    """host:port, from the line that ``rmll-hil serve`` begins with."""
    assert emulator.stdout
    line = emulator.stdout.readline()
    if not line:
        _, complaint = emulator.communicate(timeout=PATIENCE)
        raise Failure(f"the emulator did not start: {_reason(complaint)}")
    return line.split()[-1]


def _report(daemon: subprocess.Popen[str]) -> dict:
    """The JSON object of a daemon that has ended; a fault of the robot is part of it."""
    text, complaint = daemon.communicate()
    if text.strip():
        return json.loads(text)
    raise (InputError if daemon.returncode == 2 else Failure)(_reason(complaint))


def _reason(complaint: str) -> str:
    """What a command says as it ends badly, without its own name in front."""
    return complaint.strip().rpartition("\n")[2].partition(": ")[2] or "no reason given"
