"""``rmll-hil faults``: provoke every fault of the table, and see what the daemon does.

The daemon is the real one, a process of its own; the robot is emulated in a thread here; between
them is UDP over loopback, in real time. The robot's movements are brisk, all else is as it comes.
"""

import json
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rmll_hil import broken_policy
from rmll_hil.emulator import Emulator
from rmll_hil.fault_rows import BEGIN, Reaction, Row
from rmll_hil.faults import parse_plan
from rmll_hil.serve import Stop, listen, serve
from rmll_onboard.a1_wire import decode_command
from rmll_robots import A1, Robot

MOTION = {"crouch": 0.3, "rise": 0.6, "settle": 0.2, "slow_down": 0.3, "sit": 0.3}
"""[s] of the daemon's movements: walking begins about 1.2 s after the first command"""
WATCHED_MS = 4000
"""How long a fault is given to show an effect; a stuck gait, the slowest, takes two seconds"""
SETTLED_MS = 500
"""A reaction that came stays for so long"""
PATIENCE = 20.0
"""[s] for the daemon to start or to end"""
ATTEMPTS = 4
_OF_A_BUSY_MACHINE = Reaction.NEVER_WALKED, Reaction.BRAKES
"""What is seen when a daemon gets no processor for 50 ms: its trial says nothing"""
TEST = "tests/hil/test_fault_table.py"
PAGE = """# Faults, and what the daemon does about them

Each row was provoked in the emulator, through the real daemon in a process of its own and over
UDP, in real time, while the robot walked at 0.4 m/s. Milliseconds are from the fault to the first
command of the reaction as it reached the robot. To sit down, the robot first walks on the spot
(here for 0.3 s). The test of a row is `{test}::test_fault[NAME]`.

Made with `rmll-hil faults --policy {policy} --out docs/faults.md`.

| fault | ms | reaction | the daemon's words | name |
|---|---|---|---|---|
{rows}
"""


@dataclass(frozen=True)
class Result:
    """What came of a row."""

    row: Row
    reaction: Reaction
    milliseconds: int | None
    """From the fault to the first command of the reaction, as it reaches the robot"""
    told: str
    """The daemon's fault or its warnings"""

    @property
    def as_expected(self) -> bool:
        return self.reaction == self.row.reaction and self.row.words in self.told


class _Watched(Emulator):
    """An emulated robot that notes what it is told to do."""

    def __init__(self, plan: list[dict[str, Any]], robot: Robot) -> None:
        self.told: list[tuple[int, Reaction]] = []
        """Robot's time [ms] and what it was told, whenever that changed"""
        self._robot = robot
        super().__init__(robot=robot, plan=parse_plan(plan, robot))

    def receive(self, datagram: bytes) -> bool:
        good = super().receive(datagram)
        if good:
            self._note(self._kind(datagram))
        return good

    def advance(self, milliseconds: int, time_ns: int) -> None:
        super().advance(milliseconds, time_ns)
        if self.told and not self.board.mode.any():
            self._note(Reaction.BRAKES)

    def _note(self, kind: Reaction) -> None:
        if not self.told or self.told[-1][1] is not kind:
            self.told.append((self.now_ms, kind))

    def _kind(self, datagram: bytes) -> Reaction:
        command = decode_command(datagram)
        if not command.kp.any():
            return Reaction.DAMPS
        if command.kp[0] == self._robot.kp:
            return Reaction.WALKS
        folded = np.abs(command.q - self._robot.crouch_pose).max() < 0.1
        return Reaction.SITS if folded else Reaction.STANDS


class _Trial:
    """One row, with its own robot and daemon."""

    def __init__(self, row: Row, policy: Path, robot: Robot) -> None:
        self._row = row
        self._policy = policy
        self._robot = _Watched([dict(entry) for entry in row.plan], robot)
        self._begin_ms = int(BEGIN * 1000)

    def run(self) -> Result:
        stop = Stop()
        with listen("127.0.0.1", 0) as sock, tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            policy = self._policy
            if self._row.answer is not None:
                policy = folder / "broken.onnx"
                broken_policy.write(policy, self._policy, self._row.answer)
            board = threading.Thread(target=serve, args=(self._robot, sock, "stream", stop))
            board.start()
            try:
                with self._daemon(sock, policy, folder / "settings.yaml") as daemon:
                    return self._watch(daemon)
            finally:
                stop.wanted = True
                board.join()

    def _watch(self, daemon: subprocess.Popen[str]) -> Result:
        try:
            for number in self._signals(daemon):
                daemon.send_signal(number)
            reaction, after_ms = self._reaction()
            daemon.terminate()
            text, complaint = daemon.communicate(timeout=PATIENCE)
        finally:
            daemon.kill()
        # one that was killed, or that did not start, leaves no report
        report = json.loads(text) if text.strip() else {"fault": complaint, "warnings": []}
        told = report["fault"] or "; ".join(report["warnings"])
        return Result(self._row, reaction, after_ms, told.strip())

    def _daemon(self, sock: socket.socket, policy: Path, settings: Path) -> subprocess.Popen[str]:
        settings.write_text(yaml.safe_dump({"motion": MOTION, "safety": self._row.settings}))
        host, port = sock.getsockname()
        leader = [] if self._row.remote else ["--vx", "0.4"]
        command = [
            *(sys.executable, "-m", "rmll_onboard.cli", "--json", *leader),
            *("--policy", str(policy), "--settings", str(settings)),
            *("--robot-address", f"{host}:{port}"),
        ]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)

    def _signals(self, daemon: subprocess.Popen[str]) -> Iterator[signal.Signals]:
        """The row's signals, each at its time; ends when there is nothing more to see."""
        signals = [(after, signal.Signals[name]) for after, name in self._row.signals]
        give_up = time.monotonic() + PATIENCE
        while time.monotonic() < give_up:
            now_ms = self._robot.now_ms
            if now_ms == 0 and daemon.poll() is not None:
                return
            if signals and now_ms >= self._begin_ms + signals[0][0] * 1000:
                yield signals.pop(0)[1]
            elif not signals and self._over(now_ms):
                return
            time.sleep(0.002)

    def _over(self, now_ms: int) -> bool:
        _, after_ms = self._reaction()
        passed = now_ms - self._begin_ms
        return passed > (WATCHED_MS if after_ms is None else after_ms + SETTLED_MS)

    def _reaction(self) -> tuple[Reaction, int | None]:
        """What the robot was told to do instead of walking on, and when that began."""
        told = [(at - self._begin_ms, kind) for at, kind in self._robot.told]
        before = [kind for at, kind in told if at < 0]
        if before[-1:] != [Reaction.WALKS]:
            return Reaction.NEVER_WALKED, None
        after = [(at, kind) for at, kind in told if at >= 0 and kind is not Reaction.WALKS]
        if not after:
            return Reaction.WALKS, None
        at, first = after[0]
        # sitting down begins in the pose of standing
        folds = first is Reaction.STANDS and any(kind is Reaction.SITS for _, kind in after)
        return (Reaction.SITS if folds else first), at


def provoke(rows: Iterable[Row], policy: Path, jobs: int, robot: Robot = A1) -> Iterator[Result]:
    """Run the rows, ``jobs`` at a time, and give their results in the rows' order."""
    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(lambda row: _provoke(row, policy, robot), rows)


def _provoke(row: Row, policy: Path, robot: Robot) -> Result:
    """Until the row's fault was the only one: on a busy machine others get in before it."""
    for _ in range(ATTEMPTS - 1):
        result = _Trial(row, policy, robot).run()
        if result.reaction is row.reaction or result.reaction not in _OF_A_BUSY_MACHINE:
            return result
    return _Trial(row, policy, robot).run()


def markdown(results: Sequence[Result], policy: Path) -> str:
    """The table as a page of the documentation."""
    lines = [
        f"| {result.row.what} | {_plain(result.milliseconds)} | {result.reaction} "
        f"| {result.told or '-'} | `{result.row.name}` |"
        for result in results
    ]
    return PAGE.format(policy=policy, test=TEST, rows="\n".join(lines))


def _plain(milliseconds: int | None) -> str:
    return "-" if milliseconds is None else str(milliseconds)
