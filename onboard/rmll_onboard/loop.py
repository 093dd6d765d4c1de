"""The loop that owns time: a tick at every deadline, and damping however it ends."""

import gc
import resource
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from rmll_gaits.errors import Failure
from rmll_onboard.daemon import Daemon
from rmll_onboard.link import Link
from rmll_onboard.supervisor import NS

FAREWELL = 0.5
"""[s] of damping datagrams at the end"""

_STOP_SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP


class Loop:
    """Runs a daemon on a link in real time and measures how well time was kept."""

    def __init__(self, daemon: Daemon, link: Link) -> None:
        self.stopped_by: signal.Signals | None = None
        """The signal that ended the run, None if nothing was left to do"""
        self._daemon = daemon
        self._link = link
        self._signals = 0
        self._sent = 0
        self._tick = _Durations()
        self._wake = _Durations()

    def run(self, startup_timeout: float) -> None:
        """Tick until the daemon has finished, a second signal comes, or the robot stays silent.

        A first signal makes the robot sit down, a second one damps at once. Every way out,
        errors included, ends in damping datagrams. Raises Failure if no state comes within
        ``startup_timeout`` seconds.
        """
        with self._handling_signals():
            try:
                gc.collect()
                gc.freeze()
                self._run(startup_timeout)
            finally:
                self._farewell()

    def report(self) -> dict[str, Any]:
        """Times in us, peak resident memory in MB (on Linux), datagram counts."""
        daemon = self._daemon
        return {
            "tick_us": self._tick.percentiles(),
            "wake_us": self._wake.percentiles(),
            "rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
            "packets": {
                "sent": self._sent,
                "received": daemon.received,
                "rejected": daemon.rejected,
                "lost": daemon.lost,
            },
        }

    def _run(self, startup_timeout: float) -> None:
        daemon, link, period = self._daemon, self._link, self._daemon.period
        deadline = time.monotonic_ns()
        give_up = deadline + startup_timeout * NS
        while not daemon.finished and self._signals < 2:
            deadline += period
            time.sleep(max(0, deadline - time.monotonic_ns()) / NS)
            now = time.monotonic_ns()
            self._wake.add(now - deadline)
            # after a stall go on with the next deadline of the grid, do not hurry to catch up
            deadline += (now - deadline) // period * period
            datagram = link.receive()
            link.send(daemon.tick(now, datagram))
            self._sent += 1
            if daemon.policy_ran:
                self._tick.add(time.monotonic_ns() - now)
            daemon.stopping = self._signals > 0
            if not daemon.received and now > give_up:
                raise Failure(f"no answer from the robot at {link.name} in {startup_timeout:g} s")

    def _farewell(self) -> None:
        frame = self._daemon.damping()
        for _ in range(int(FAREWELL * NS / self._daemon.period)):
            self._link.send(frame)
            self._sent += 1
            time.sleep(self._daemon.period / NS)

    @contextmanager
    def _handling_signals(self) -> Iterator[None]:
        before = {number: signal.signal(number, self._on_signal) for number in _STOP_SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: int, frame: object) -> None:
        self.stopped_by = self.stopped_by or signal.Signals(number)
        self._signals += 1


class _Durations:
    """The last million durations."""

    def __init__(self) -> None:
        self._us = np.empty(1 << 20, np.float32)
        self._count = 0

    def add(self, nanoseconds: int) -> None:
        self._us[self._count % len(self._us)] = nanoseconds / 1000
        self._count += 1

    def percentiles(self) -> dict[str, float] | None:
        """p50, p99, p999 and max in us; None before the first duration."""
        seen = self._us[: self._count]
        if not len(seen):
            return None
        values = np.percentile(seen, [50, 99, 99.9, 100]).round(1).tolist()
        return dict(zip(("p50", "p99", "p999", "max"), values, strict=True))
