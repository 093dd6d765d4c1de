"""How well time is kept: every tick is counted, in memory that does not grow."""

from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec.structs import asdict

from rmll_onboard.state.reports import (
    LowerPercentiles,
    Timekeeping,
    TimingReport,
    UpperPercentiles,
)

_LONGEST = 1 << 16
"""[us]; longer ones are counted as this, and only the extremes are exact"""
_MINUTE = 60_000_000_000


class Durations:
    """Counts durations, a bin a microsecond."""

    def __init__(self) -> None:
        self._counts = array("Q", bytes(8 * _LONGEST))
        self._shortest = self._longest = 0
        self._any = False

    def add(self, nanoseconds: int) -> None:
        """A negative duration is counted as none, but kept as the shortest one."""
        self._counts[min(max(nanoseconds // 1000, 0), _LONGEST - 1)] += 1
        if not self._any:
            self._shortest = self._longest = nanoseconds
            self._any = True
        elif nanoseconds > self._longest:
            self._longest = nanoseconds
        elif nanoseconds < self._shortest:
            self._shortest = nanoseconds

    def highest(self) -> UpperPercentiles | None:
        """None before the first duration."""
        if not self._any:
            return None
        return UpperPercentiles(*self._quantiles(0.5, 0.99, 0.999), max=_us(self._longest))

    def lowest(self) -> LowerPercentiles | None:
        """None before the first duration."""
        if not self._any:
            return None
        return LowerPercentiles(*self._quantiles(0.5, 0.01, 0.001), min=_us(self._shortest))

    def _quantiles(self, *shares: float) -> list[float]:
        """For each share, what so many of the durations do not exceed, to the microsecond."""
        below = np.cumsum(np.frombuffer(self._counts, np.uint64))
        bins = np.searchsorted(below, np.array(shares) * float(below[-1]))
        return [float(index) for index in bins]


def _us(nanoseconds: int) -> float:
    return round(nanoseconds / 1000, 1)


class Timing:
    """The figures of a loop."""

    def __init__(self) -> None:
        self.wake = Durations()
        """Lateness of a wake-up against its deadline"""
        self.tick = Durations()
        """A policy tick, from the receive call to the return of the send call"""
        self.plain_tick = Durations()
        """The same of a tick without the policy"""
        self.slack = Durations()
        """What is left of a period when everything is done; negative if it was too short"""
        self.missed = 0
        """Deadlines that were left out because a tick ended after them"""
        self._memory: list[float] = []
        self._next_look = 0

    def look_at_memory(self, now: int) -> None:
        """Note the resident memory, once a minute."""
        if now >= self._next_look:
            self._next_look = now + _MINUTE
            self._memory.append(memory_mb("VmRSS"))

    def report(self) -> TimingReport:
        """All so far."""
        return TimingReport(
            tick_us=self.tick.highest(),
            wake_us=self.wake.highest(),
            rss_mb=memory_mb("VmHWM"),
            timekeeping=Timekeeping(
                plain_tick_us=self.plain_tick.highest(),
                slack_us=self.slack.lowest(),
                missed=self.missed,
                memory_mb=(*self._memory, memory_mb("VmRSS")),
            ),
        )


def memory_mb(kind: Literal["VmRSS", "VmHWM"]) -> float:
    """Resident memory of this process, now or at its peak; 0 where the system does not tell it.

    Not from getrusage, whose peak is that of the parent process too.
    """
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0.0
    kilobytes = next(line.split()[1] for line in lines if line.startswith(kind))
    return round(int(kilobytes) / 1024, 1)


def table(report: TimingReport) -> str:
    """What :meth:`Timing.report` says, for people."""
    kept = report.timekeeping
    if kept is None:
        return "time was not measured"
    rows = {
        "late wake-up": report.wake_us,
        "policy tick": report.tick_us,
        "plain tick": kept.plain_tick_us,
        "slack": kept.slack_us,
    }
    lines: list[str] = []
    header: list[str] = []
    for name, percentiles in rows.items():
        if percentiles is None:
            continue
        values = asdict(percentiles)
        if list(values) != header:
            header = list(values)
            lines.append(_line("[us]", header))
        lines.append(_line(name, [f"{value:.0f}" for value in values.values()]))
    memory = [f"{value:.1f}" for value in kept.memory_mb]
    lines.append(_line("missed deadlines", [str(kept.missed)]))
    return "\n".join([*lines, f"{'memory [MB]':18}{' '.join(memory)}"])


def _line(name: str, values: Sequence[str]) -> str:
    return f"{name:18}" + "".join(f"{value:>9}" for value in values)
