"""Virtual time: the daemon's own loop on a clock that passes as fast as the robot is computed.

One object is the loop's clock and its link. Whenever the loop sleeps or looks at the time, the
board on the other end lives through as much of it, as :mod:`rmll_hil.robot.serve` does in real
time: a state every 2 ms. Signals are real ones, sent to this process at a moment of the robot's
time.
"""

import signal
from collections.abc import Callable, Iterable

from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.serve import PERIOD_MS, PERIOD_NS
from rmll_onboard.state.modes import NS

LOOK_NS = 10_000
"""[ns] that pass when the loop looks at the clock: waiting for a moment has an end"""


class Killed(BaseException):
    """The process would have ended here; no handler of errors may see it as one."""


class VirtualTime:
    """A clock and a link to an emulated robot; its time begins with the first good command.

    After :class:`Killed`, or once :attr:`alive` is set to False, time passes on but nothing is
    sent.
    """

    name = "an emulated robot in virtual time"

    def __init__(self, emulator: Emulator, signals: Callable[[], Iterable[signal.Signals]]) -> None:
        """``signals`` is asked at every period of the board for those that are due."""
        self.alive = True
        """Whether there is a process that sends, and that signals reach"""
        self._emulator = emulator
        self._signals = signals
        self._now = 0
        self._next: int | None = None
        """[ns] the board's next period; None before the first command"""
        self._held_up = False
        self._waiting: list[bytes] = []

    def monotonic_ns(self) -> int:
        self._pass(LOOK_NS)
        return self._now

    def sleep(self, seconds: float) -> None:
        self._pass(round(seconds * NS))

    def send(self, datagram: bytes) -> None:
        if not self.alive:
            return
        if self._next is None:
            if self._emulator.receive(datagram):
                self._next = self._now
            return
        self._emulator.to_robot.send(datagram, self._emulator.now_ms)
        self._hear()

    def receive(self) -> list[bytes]:
        datagrams, self._waiting = self._waiting, []
        return datagrams

    def close(self) -> None:
        pass

    def _pass(self, nanoseconds: int) -> None:
        """Let time pass; longer if the process is held up meanwhile."""
        end = self._now + nanoseconds
        while self._next is not None and (self._next <= end or self._held_up):
            self._now = self._next
            self._next += PERIOD_NS
            self._period()
        self._now = max(self._now, end)

    def _period(self) -> None:
        emulator = self._emulator
        self._hear()
        emulator.from_robot.send(emulator.state_datagram(), emulator.now_ms)
        self._waiting += [datagram for datagram, _ in emulator.from_robot.arrived(emulator.now_ms)]
        emulator.advance(PERIOD_MS, self._now)
        if self.alive:
            for number in self._signals():
                self._deliver(number)

    def _hear(self) -> None:
        emulator = self._emulator
        for datagram, _ in emulator.to_robot.arrived(emulator.now_ms):
            emulator.receive(datagram)

    def _deliver(self, number: signal.Signals) -> None:
        """Raises Killed for a signal that ends the process; a handler runs at once."""
        if number in (signal.SIGSTOP, signal.SIGCONT):
            self._held_up = number is signal.SIGSTOP
        elif number is signal.SIGKILL or signal.getsignal(number) is signal.SIG_DFL:
            self.alive = False
            raise Killed(number.name)
        else:
            signal.raise_signal(number)
