"""The recording process: ticks from a pipe into a file, until the pipe ends.

It ends with its pipe and with nothing else, so it outlives whatever kills the daemon, and leaves a
proper file then too. ``python -m rmll_onboard.recording.recorder_process FILE MAX_MB`` is started
by :mod:`rmll_onboard.recording.recorder`.
"""

import errno
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from rmll_onboard.recording.log_metadata import LogMetadata
from rmll_onboard.recording.mcap_writer import McapWriter
from rmll_onboard.recording.recorder import LENGTH
from rmll_onboard.recording.telemetry import Tick
from rmll_onboard.state.reports import RecordingResult

FLUSH = 1.0
"""[s] that a crash of this process or of the machine may cost"""
_NAP = 0.05
"""[s] between two looks into the pipe"""
_GULP = 1 << 20


class Recording:
    """A log that keeps within its share of the disk.

    When the file has half of ``max_bytes``, it becomes FILE.before.mcap, in place of an older one,
    and a new one begins: the newest half is always there.
    """

    def __init__(self, path: Path, about: LogMetadata, max_bytes: float) -> None:
        """Raises OSError, FileExistsError for an old log among others."""
        self.ticks = 0
        self._path = path
        self._before = path.with_name(f"{path.stem}.before{path.suffix}")
        self._about = about
        self._max_bytes = max_bytes
        if self._before.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(self._before))
        self._begin()

    @property
    def bytes(self) -> int:
        """On the disk."""
        return sum(path.stat().st_size for path in (self._before, self._path) if path.exists())

    def add(self, tick: Tick) -> None:
        self._file.add(tick)
        self.ticks += 1
        if self._stream.tell() > self._max_bytes / 2:
            self.close()
            self._path.replace(self._before)
            self._begin()

    def flush(self) -> None:
        """Bring all to the disk."""
        self._file.flush()
        os.fdatasync(self._stream.fileno())

    def close(self) -> None:
        """Give the file its proper end."""
        self._file.finish()
        self._stream.close()

    def _begin(self) -> None:
        self._stream = self._path.open("xb")
        self._file = McapWriter(self._stream, self._about)


def record(pipe: int, path: Path, max_bytes: float) -> RecordingResult:
    """Write until the pipe ends or something goes wrong; returns what was written."""
    recording: Recording | None = None
    trouble = None
    flushed = time.monotonic()
    try:
        for messages in _looks(pipe):
            for message in messages:
                if recording is None:
                    about = msgspec.msgpack.decode(message, type=LogMetadata)
                    recording = Recording(path, about, max_bytes)
                else:
                    recording.add(msgspec.msgpack.decode(message, type=Tick))
            if recording is not None and time.monotonic() - flushed >= FLUSH:
                recording.flush()
                flushed = time.monotonic()
        if recording is not None:
            recording.close()
    except OSError as error:
        trouble = f"{error.filename or path}: {error.strerror}"
    except Exception as error:  # whatever it is: one line, and the daemon walks on
        trouble = f"{path}: {error!r}"
    return RecordingResult(
        ticks=recording.ticks if recording else 0,
        megabytes=round(recording.bytes / 1e6, 3) if recording else 0.0,
        trouble=trouble,
    )


def _looks(pipe: int) -> Iterator[list[bytes]]:
    """The messages that came since the last look."""
    os.set_blocking(pipe, False)
    rest = bytearray()
    while True:
        try:
            gulp = os.read(pipe, _GULP)
        except BlockingIOError:
            gulp = None
        if gulp == b"":
            return
        rest += gulp or b""
        yield _messages(rest)
        time.sleep(_NAP)


def _messages(rest: bytearray) -> list[bytes]:
    """The whole messages at the beginning of ``rest``, which are taken out of it."""
    messages, position = [], 0
    while position + LENGTH.size <= len(rest):
        (length,) = LENGTH.unpack_from(rest, position)
        start = position + LENGTH.size
        if start + length > len(rest):
            break
        messages.append(bytes(rest[start : start + length]))
        position = start + length
    del rest[:position]
    return messages


def main() -> int:
    path, max_mb = Path(sys.argv[1]), float(sys.argv[2])
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    with suppress(OSError, AttributeError):  # whatever the daemon's priority was
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    result = record(0, path, max_mb * 1e6)
    if result.trouble:
        with suppress(OSError):
            print(f"rmll-onboard: no recording: {result.trouble}", file=sys.stderr)
    print(msgspec.json.encode(result).decode(), flush=True)
    return 1 if result.trouble else 0


if __name__ == "__main__":
    sys.exit(main())
