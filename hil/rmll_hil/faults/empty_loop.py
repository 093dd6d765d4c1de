"""A loop that does nothing but wait, measured beside something that has to keep time.

It sleeps and watches the clock as the daemon does, in a process of its own. How late it was is the
machine's doing: a program beside it is not to blame for as much.
"""

import signal
import subprocess
import sys
import time
from types import TracebackType

PERIOD_NS = 5_000_000
EARLY_NS = 200_000
PATIENCE = 60.0
"""[s] for it to end"""


class EmptyLoop:
    """Runs during a ``with`` block; :attr:`late_ms` is known after it."""

    late_ms = 0.0
    """[ms] The latest that it woke up"""

    @property
    def pid(self) -> int:
        return self._process.pid

    def __enter__(self) -> "EmptyLoop":
        command = [sys.executable, "-m", __name__]
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout
        self._process.stdout.readline()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._process.terminate()
            self.late_ms = float(self._process.communicate(timeout=PATIENCE)[0])
        finally:
            self._process.kill()


def main() -> None:
    """Until SIGTERM; prints a line when it has begun, and how late it was [ms] when it ends."""
    ends: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: ends.append(number))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started it ends it
    worst = 0
    deadline = time.monotonic_ns()  # whatever happens once the line is out is noticed
    print("running", flush=True)
    ended = False
    while not ended:
        ended = bool(ends)  # a last look, so that no lateness goes unseen
        deadline += PERIOD_NS
        time.sleep(max(0, deadline - EARLY_NS - time.monotonic_ns()) / 1e9)
        while time.monotonic_ns() < deadline:
            pass
        late = time.monotonic_ns() - deadline
        worst = max(worst, late)
        deadline += late // PERIOD_NS * PERIOD_NS
    print(worst / 1e6)


if __name__ == "__main__":
    main()
