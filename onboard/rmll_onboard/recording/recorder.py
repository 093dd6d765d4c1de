"""Handing ticks to the process that writes them, in a few microseconds and come what may.

A process and not a thread: packing and writing then never hold Python's lock, a crash or a slow
disk stays on the other side of a pipe, and what was handed over survives a kill of this side. The
pipe has no reader waiting on it, who would be woken up at every tick; it looks in by itself.
"""

import fcntl
import os
import struct
import subprocess
import sys
import time
from collections import deque
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import msgspec
from msgspec.structs import astuple

from rmll_common.errors import Failure
from rmll_onboard.recording.log_metadata import LogMetadata
from rmll_onboard.recording.mcap_writer import NEEDS
from rmll_onboard.recording.telemetry import Tick
from rmll_onboard.state.reports import RecordingReport, RecordingResult

LENGTH = struct.Struct("<I")
"""Before every message in the pipe"""
PATIENCE = 10.0
"""[s] for the process to bring all to the disk at the end"""

_NICE = 10
"""Of the process; all that it does can wait"""
_PIPE_SIZE = 1 << 20
_WAITING_LIMIT = 16 << 20
"""[bytes] kept here while the disk stalls; 40 s of ticks"""
_BURST = 8
"""Messages handed over at a tick at most, so that a stall's backlog holds up no tick"""


def log_path(wanted: Path, gait: str) -> Path:
    """The file to record to: ``wanted``, or in a folder of that name one of the gait and time.

    A service that starts again and again can only be given a folder, for no log is overwritten.
    """
    return wanted / f"{gait}-{time.strftime('%Y%m%d-%H%M%S')}.mcap" if wanted.is_dir() else wanted


class Recorder:
    """Never raises once it is made, and never waits before :meth:`close`."""

    def __init__(self, path: Path, about: LogMetadata, max_mb: float) -> None:
        """``path`` must not exist; ``max_mb`` bounds what is on the disk at any time.

        Raises Failure if the library is missing. All other trouble is told on stderr by the
        recording process, and here in :meth:`report`.
        """
        if find_spec("mcap") is None:
            raise Failure(NEEDS.format("mcap"))
        self.dropped = 0
        """Ticks that could not be handed over"""
        self._path = path
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = self._sent_of_first = 0
        self._encoder = msgspec.msgpack.Encoder()
        self._result = RecordingResult(None, None, "the recording process died")
        reading, self._pipe = os.pipe()
        self._open = True
        with suppress(OSError, AttributeError):  # a smaller pipe does too
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
        os.set_blocking(self._pipe, False)
        # a session of its own: Ctrl-C and a closed terminal end the walk, and then the recording
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "rmll_onboard.recording.recorder_process",
                str(path),
                str(max_mb),
            ],
            stdin=reading,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        os.close(reading)
        with suppress(OSError):  # from the outside, so that it starts up with it already
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICE)
        self._hand_over(self._encoder.encode(about))

    def keep(self, tick: Tick) -> None:
        """Hand over a tick, or drop it if the other side has not kept up for long or is gone."""
        self._hand_over(self._encoder.encode(tick))

    def close(self) -> None:
        """Wait until all is written; gives up after ``PATIENCE``."""
        deadline = time.monotonic() + PATIENCE
        while self._waiting and time.monotonic() < deadline:
            if not self._push():
                time.sleep(0.01)
        os.close(self._pipe)
        self._open = False
        try:
            told, _ = self._process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            told, _ = self._process.communicate()
        with suppress(msgspec.DecodeError):
            self._result = msgspec.json.decode(told, type=RecordingResult)

    def report(self) -> RecordingReport:
        """After :meth:`close`."""
        return RecordingReport(str(self._path), self.dropped, *astuple(self._result))

    def _hand_over(self, message: bytes) -> None:
        if not self._open or self._waiting_bytes > _WAITING_LIMIT:
            self.dropped += 1
            return
        self._waiting.append(LENGTH.pack(len(message)) + message)
        self._waiting_bytes += len(self._waiting[-1])
        for _ in range(_BURST):
            if not (self._waiting and self._push()):
                return

    def _push(self) -> bool:
        """Write what the pipe takes of the first message; False if it is full or broken."""
        first = self._waiting[0]
        try:
            written = os.write(self._pipe, first[self._sent_of_first :])
        except BlockingIOError:
            return False
        except OSError:  # nobody is there to read
            self.dropped += len(self._waiting)
            self._waiting.clear()
            self._open = False
            return False
        self._sent_of_first += written
        if self._sent_of_first == len(first):
            self._waiting.popleft()
            self._waiting_bytes -= len(first)
            self._sent_of_first = 0
        return True
