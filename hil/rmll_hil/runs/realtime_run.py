"""Emulator and daemon as two processes that talk UDP over loopback, in real time."""

import dataclasses
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import numpy as np

from rmll_common.errors import Failure, InputError
from rmll_hil.robot.emulator import EmulatorSettings
from rmll_hil.runs.outcome import AFTERMATH, Outcome
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.settings.runtime_settings import RuntimeSettings as DaemonSettings
from rmll_onboard.settings.runtime_settings import as_yaml
from rmll_onboard.state.reports import RunReport

PATIENCE = 8.0
"""[s] for a process to end by itself; sitting down takes about three"""
LATE_TICKS = 10
"""Of 5 ms each: as long as the daemon lives without a state, and the robot without a command"""


def walk(
    daemon_flags: list[str],
    settings: EmulatorSettings,
    record: Path,
    progress: Callable[[float], None],
    faults: Path | None = None,
    daemon_settings: DaemonSettings = DaemonSettings(),  # noqa: B008 - frozen
) -> Outcome:
    """Start both, wait until the daemon has finished, and end the emulator.

    Args:
        daemon_flags: of ``rmll-onboard``, without the robot's address.
        record: a new file for the daemon's flight recorder.
        progress: hears the seconds since the daemon's start.
        faults: the file of a fault plan for the emulator.
        daemon_settings: the link, and all else that the daemon's settings file has.

    Raises InputError or Failure, whichever the daemon ended with, if it has nothing to report.
    """
    onboard = ["rmll_onboard.cli", *daemon_flags, "--record", str(record), "--json"]
    with tempfile.TemporaryDirectory(prefix="rmll-hil-") as scratch:
        truth_path, settings_path = Path(scratch, "truth.npz"), Path(scratch, "settings.yaml")
        settings_path.write_text(as_yaml(daemon_settings))
        wired = ["--link", daemon_settings.link.kind, "--settings", str(settings_path)]
        serve = _serve(settings, truth_path, faults)
        with _interruptible(), _process([*serve, *wired]) as emulator:
            address = _address(emulator)
            if daemon_settings.link.kind == "udp":
                wired += ["--robot-address", address]
            with _process([*onboard, *wired]) as process:
                began = time.monotonic()
                # an emulator that died is noticed by the daemon, as on the robot
                while process.poll() is None:
                    progress(time.monotonic() - began)
                    time.sleep(0.1)
                report = _report(process)
            if report.fault:
                time.sleep(AFTERMATH)
            _end(emulator)
        with np.load(truth_path) as saved:
            truth, counters = saved["truth"], json.loads(str(saved["counters"]))
    if report.record and (trouble := report.record.trouble):
        raise Failure(f"the flight recorder: {trouble}")
    return Outcome(report, list(FlightLog(record).rows()), truth, counters["realtime_factor"])


def too_busy(report: RunReport) -> str | None:
    """Why the machine and not the robot may be to blame for how a run ended; None if it kept time.

    ``report`` is the daemon's. An emulator that nobody breaks on purpose always answers in time.
    """
    missed = report.timekeeping.missed if report.timekeeping else 0
    lost = report.packets.lost
    if missed + lost < LATE_TICKS:
        return None
    return (
        f"the machine is too busy: of {report.packets.sent} ticks {missed} were missed and "
        f"{lost} had no new state; close other programs, or use --lockstep, which has no hurry"
    )


def read_report(text: str) -> RunReport:
    """The JSON that ``rmll-onboard --json`` printed, checked; raises Failure."""
    try:
        return msgspec.json.decode(text, type=RunReport)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Failure(f"the daemon's report cannot be read: {error}") from error


def _serve(settings: EmulatorSettings, truth: Path, faults: Path | None) -> list[str]:
    flags = [
        text
        for name, value in dataclasses.asdict(settings).items()
        for text in (f"--{name.replace('_', '-')}", str(value))
    ]
    plan = ["--faults", str(faults)] if faults else []
    return ["rmll_hil.cli", "serve", "--port", "0", "--log", str(truth), *flags, *plan]


def _end(emulator: subprocess.Popen[str]) -> None:
    emulator.terminate()
    try:
        _, complaint = emulator.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        raise Failure(
            f"the emulator did not end within {PATIENCE:g} s: the machine is too busy"
        ) from None
    if emulator.returncode:
        raise Failure(
            f"the emulator ended with exit code {emulator.returncode}: {_reason(complaint)}"
        )


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
    """host:port or a bus, from the line that ``rmll-hil serve`` begins with."""
    assert emulator.stdout
    line = emulator.stdout.readline()
    if not line:
        _, complaint = emulator.communicate(timeout=PATIENCE)
        raise Failure(f"the emulator did not start: {_reason(complaint)}")
    return line.split()[-1]


def _report(daemon: subprocess.Popen[str]) -> RunReport:
    """What a daemon that has ended printed; a fault of the robot is part of it."""
    text, complaint = daemon.communicate()
    if text.strip():
        return read_report(text)
    raise (InputError if daemon.returncode == 2 else Failure)(_reason(complaint))


def _reason(complaint: str) -> str:
    """What a command says as it ends badly, without its own name in front."""
    return complaint.strip().rpartition("\n")[2].partition(": ")[2] or "no reason given"
