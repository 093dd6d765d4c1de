"""Emulator and daemon in one process, taking turns: deterministic and faster than real time.

They exchange the same datagrams as over the network, but there is no socket and no wall clock:
each command is followed by one control period of physics, and that by one state.
"""

import csv
import io
import time
from collections.abc import Callable

from rmll_hil.emulator import Emulator
from rmll_hil.outcome import AFTERMATH, Outcome
from rmll_onboard.bundle import Bundle
from rmll_onboard.daemon import Daemon
from rmll_onboard.log import Log
from rmll_onboard.loop import FAREWELL
from rmll_onboard.pilot import Pilot
from rmll_onboard.settings import Settings
from rmll_onboard.supervisor import NS


def walk(
    emulator: Emulator, bundle: Bundle, pilot: Pilot, progress: Callable[[float], None]
) -> Outcome:
    """Run until the daemon has finished; ``progress`` hears the robot's time [s] at 50 Hz."""
    rows = Log(bundle)
    daemon = Daemon(bundle, Settings(), pilot, rows)
    period_ms = daemon.period // 1_000_000
    began = time.perf_counter()
    datagram = None
    while not daemon.finished:
        now = emulator.now_ms * 1_000_000
        emulator.receive(daemon.tick(now, datagram))
        emulator.advance(period_ms, now)
        datagram = emulator.state_datagram()
        if daemon.policy_ran:
            progress(now / NS)
    for _ in range(int(FAREWELL * NS / daemon.period)):
        emulator.receive(daemon.damping())
        emulator.advance(period_ms, emulator.now_ms * 1_000_000)
    if daemon.fault:
        emulator.advance(int(AFTERMATH * 1000), emulator.now_ms * 1_000_000)
    wall = time.perf_counter() - began
    packets = {
        "sent": emulator.received,
        "received": daemon.received,
        "rejected": daemon.rejected,
        "lost": daemon.lost,
    }
    # not measured: there is no real time here
    timings = dict.fromkeys(("tick_us", "wake_us", "rss_mb"))
    return Outcome(
        report=daemon.report() | timings | {"packets": packets},
        log=_table(rows),
        truth=emulator.truth(),
        realtime_factor=emulator.now_ms / 1000 / wall,
    )


def _table(rows: Log) -> list[dict[str, str]]:
    text = io.StringIO()
    rows.write(text)
    text.seek(0)
    return list(csv.DictReader(text))
