"""A row of the fault table in real time: the daemon a process of its own, UDP in between.

The robot has this process to itself: who watches it has no thread that could keep it from time.
"""

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

from rmll_hil.faults.empty_loop import EmptyLoop
from rmll_hil.faults.fault_rows import FaultRow, Reaction
from rmll_hil.faults.fault_trial import MOTION, VX, FaultTrial, words
from rmll_hil.robot.serve import listen, serve
from rmll_hil.runs.realtime_run import read_report

PATIENCE = 60.0
"""[s] for a daemon to start, walk and end"""
PATIENT = {"missed_ticks": 400}
"""Safety settings of rows that are not about time"""
LARGEST_LAG_NS = 20_000_000
"""A robot that hurries to catch up has less patience with its daemon than 50 ms"""
BUSY_MS = 10.0
"""[ms] If even an empty loop, or the robot itself, was so late, nothing can be said about a wrong
reaction: the board waits for 50 ms for a command, and the daemon for a state"""


class _Watch:
    """Sends the daemon its signals, and ends the robot when the daemon has ended."""

    def __init__(self, trial: FaultTrial, daemon: subprocess.Popen[str]) -> None:
        self._trial = trial
        self._daemon = daemon
        self._give_up = time.monotonic() + PATIENCE
        self._began: float | None = None
        self.late_ms = 0.0
        """How far the robot's time fell behind, as long as it was watched"""

    @property
    def wanted(self) -> bool:
        """Looked at in every period of the robot."""
        self._look_at_time()
        for number in self._trial.signals():
            self._daemon.send_signal(number)
        gone = self._daemon.poll() is not None
        nothing_to_see = self._trial.begin_ms is None or self._trial.found is not None
        return (gone and nothing_to_see) or time.monotonic() > self._give_up

    def _look_at_time(self) -> None:
        passed_ms = self._trial.now_ms
        if passed_ms == 0 or self._trial.found is not None:
            return
        now = time.monotonic()
        if self._began is None:
            self._began = now - passed_ms / 1000
        self.late_ms = max(self.late_ms, (now - self._began) * 1000 - passed_ms)


def run(row: FaultRow, trial: FaultTrial, policy: Path) -> tuple[Reaction, int | None, str]:
    """The reaction, after how many milliseconds of the robot, and the daemon's words."""
    with (
        EmptyLoop() as beside,
        listen("127.0.0.1", 0) as sock,
        tempfile.TemporaryDirectory() as name,
        _daemon(row, sock, policy, Path(name, "settings.yaml")) as daemon,
    ):
        watch = _Watch(trial, daemon)
        try:
            serve(trial, sock, "stream", watch, LARGEST_LAG_NS)
        finally:
            daemon.kill()
        text, complaint = daemon.communicate()
    told = complaint.strip()  # of one that was killed, or that did not start: it leaves no report
    if text.strip():
        told = words(read_report(text))
    reaction, after_ms = trial.found or trial.reaction()
    return judged(row, (reaction, after_ms, told), beside.late_ms, watch.late_ms)


def judged(
    row: FaultRow, seen: tuple[Reaction, int | None, str], loop_ms: float, robot_ms: float
) -> tuple[Reaction, int | None, str]:
    """What was seen, unless it is wrong and the machine may be to blame.

    ``loop_ms`` and ``robot_ms`` are how late an empty loop and the robot were.
    """
    reaction, _, told = seen
    if (reaction is row.reaction and row.words in told) or max(loop_ms, robot_ms) <= BUSY_MS:
        return seen
    late = f"an empty loop was late by {loop_ms:.0f} ms, the robot by {robot_ms:.0f} ms"
    return Reaction.NOT_JUDGED, None, f"{late}; {reaction}: {told or '-'}"


def _daemon(
    row: FaultRow, sock: socket.socket, policy: Path, settings: Path
) -> subprocess.Popen[str]:
    safety = row.settings if row.needs_real_time else PATIENT | row.settings
    settings.write_text(yaml.safe_dump({"motion": MOTION, "safety": safety}))
    host, port = sock.getsockname()
    leader = [] if row.remote else ["--vx", str(VX)]
    command = [
        *(sys.executable, "-m", "rmll_onboard.cli", "--json", *leader),
        *("--policy", str(policy), "--settings", str(settings)),
        *("--robot-address", f"{host}:{port}"),
    ]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)
