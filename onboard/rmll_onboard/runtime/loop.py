"""The loop that owns time: a tick at every deadline, and damping however it ends."""

import gc
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from msgspec.structs import asdict

from rmll_common.errors import Failure
from rmll_onboard.interface.transport import Transport
from rmll_onboard.recording.telemetry import Tick
from rmll_onboard.runtime.cache_warmup import CacheWarmer
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.systemd_notify import SystemdNotifier
from rmll_onboard.runtime.tick_listener import TickListener
from rmll_onboard.runtime.timing import Timing
from rmll_onboard.settings.runtime_settings import Realtime
from rmll_onboard.state.modes import NS
from rmll_onboard.state.reports import LoopReport, PacketReport

_STOP_SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP


class Clock(Protocol):
    """What passes time: the module :mod:`time`, or a simulation."""

    def monotonic_ns(self) -> int: ...

    def sleep(self, seconds: float, /) -> None: ...


class Loop:
    """Runs a daemon on a link, a tick each period, and measures how well time was kept."""

    def __init__(
        self,
        daemon: Daemon,
        link: Transport,
        pace: Realtime,
        keep: Callable[[Tick], None] | None = None,
        service: SystemdNotifier | None = None,
        cache_warmer: CacheWarmer | None = None,
        clock: Clock = time,
    ) -> None:
        """``keep`` is given every tick once its command is sent; it must neither wait nor raise.

        ``service`` is told that we are alive. ``cache_warmer`` goes through policy ticks ahead of
        time. ``clock`` is real time unless a simulation has its own.
        """
        self.stopped_by: signal.Signals | None = None
        """The signal that ended the run, None if nothing was left to do"""
        self._daemon = daemon
        self._link = link
        self._early = pace.early_us * 1000
        self._warmup = pace.cache_warmup_us * 1000
        self._cache_warmer = cache_warmer
        self._listener = None if keep is None else TickListener(daemon, keep)
        self._service = service or SystemdNotifier({})
        self._timing = Timing()
        self._clock = clock
        self._signals = 0
        self._sent = 0

    def run(self, startup_timeout: float) -> None:
        """Tick until the daemon has finished, a second signal comes, or the robot stays silent.

        A first signal makes the robot sit down, a second one damps at once. Every way out,
        errors included, ends in damping datagrams. Raises Failure if no state comes within
        ``startup_timeout`` seconds.
        """
        with self._handling_signals(), _no_garbage_collection():
            try:
                self._run(startup_timeout)
            finally:
                self._service.stopping()
                self._farewell()

    def report(self) -> LoopReport:
        """How well time was kept, see :class:`Timing`, and datagram counts."""
        interface = self._daemon.interface
        packets = PacketReport(self._sent, interface.received, interface.rejected, interface.lost)
        return LoopReport(**asdict(self._timing.report()), packets=packets)

    def _run(self, startup_timeout: float) -> None:
        daemon, link, timing, period = self._daemon, self._link, self._timing, self._daemon.period
        monotonic_ns = self._clock.monotonic_ns
        deadline = monotonic_ns()
        give_up = deadline + startup_timeout * NS
        while not daemon.finished and self._signals < 2:
            deadline += period
            timing.slack.add(deadline - monotonic_ns())
            datagrams = self._wait(deadline)
            now = monotonic_ns()
            datagrams += link.receive()
            answer = daemon.tick(now, datagrams)
            link.send(answer)
            # the robot waits for nothing that comes from here on
            sent = monotonic_ns()
            (timing.tick if daemon.policy_ran else timing.plain_tick).add(sent - now)
            timing.wake.add(now - deadline)
            # after a stall go on with the next deadline of the grid, do not hurry to catch up
            missed = (now - deadline) // period
            timing.missed += missed
            deadline += missed * period
            self._look_around(now, datagrams, answer)
            if not daemon.interface.received and now > give_up:
                missing = f": nothing from {who}" if (who := daemon.interface.missing) else ""
                raise Failure(
                    f"no answer from the robot at {link.name} in {startup_timeout:g} s{missing}"
                )

    def _wait(self, deadline: int) -> list[bytes]:
        """Sleep, but not up to the deadline: waking up takes time, and so do cold caches.

        Returns the datagrams that a warm-up was given; the tick itself is still to see them.
        """
        monotonic_ns = self._clock.monotonic_ns
        early: list[bytes] = []
        if self._cache_warmer is not None and self._daemon.policy_next:
            self._sleep_until(deadline - self._early - self._warmup)
            early = self._link.receive()
            began = monotonic_ns()
            self._warm_up(began, early)
            done = monotonic_ns()
            # once more if there is time: what has been seen twice is foreseen by the processor
            if done + (done - began) < deadline:
                self._warm_up(done, early)
        else:
            self._sleep_until(deadline - self._early)
        while monotonic_ns() < deadline:
            pass
        return early

    def _warm_up(self, now: int, datagrams: list[bytes]) -> None:
        """Whatever goes wrong in it, the walk goes on without."""
        if self._cache_warmer is not None:
            try:
                self._cache_warmer.warm_up(now, datagrams)
            except Exception as error:
                self._cache_warmer = None
                self._daemon.warn(f"the cache warmer is off: {error!r}")

    def _sleep_until(self, moment: int) -> None:
        self._clock.sleep(max(0, moment - self._clock.monotonic_ns()) / NS)

    def _look_around(self, now: int, datagrams: list[bytes], answer: bytes) -> None:
        """All that is not between the robot's state and its command."""
        self._sent += 1
        if self._listener is not None:
            self._listener.observe(now, datagrams, answer)
        if self._daemon.interface.received:
            self._service.ready()
            self._service.alive(now)
        self._timing.look_at_memory(now)
        self._daemon.stopping = self._signals > 0

    def _farewell(self) -> None:
        frame = self._daemon.damping()
        for _ in range(int(self._daemon.interface.farewell * NS / self._daemon.period)):
            self._link.send(frame)
            self._sent += 1
            self._clock.sleep(self._daemon.period / NS)

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


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """A collection may come at any time and look at everything; a tick leaves nothing for it."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
