"""Emulator and daemon in one process, taking turns: deterministic and faster than real time.

They exchange the same datagrams as over the network, but there is no socket and no wall clock:
each command is followed by one control period of physics, and that by one state.
"""

import time
from collections.abc import Callable

from rmll_hil.robot.emulator import Emulator
from rmll_hil.runs.outcome import AFTERMATH, Outcome
from rmll_onboard.commands.operator import Operator
from rmll_onboard.control.bundle import Bundle
from rmll_onboard.recording.telemetry import TelemetryRow, Tick, columns, row, row_type
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.tick_listener import TickListener
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.modes import NS
from rmll_onboard.state.reports import LoopReport, PacketReport, RunReport


def walk(
    emulator: Emulator,
    bundle: Bundle,
    operator: Operator,
    progress: Callable[[float], None],
    record: Callable[[Tick], None] | None = None,
    settings: RuntimeSettings = RuntimeSettings(),  # noqa: B008 - frozen
    prepare: Callable[[Daemon], None] = lambda _: None,
) -> Outcome:
    """Run until the daemon has finished.

    ``progress`` hears the robot's time [s] at 50 Hz, ``record`` sees every tick; ``settings`` are
    the daemon's, which ``prepare`` may change before its first tick.
    """
    rows: list[TelemetryRow] = []
    kind = row_type(columns(bundle.contract))

    def keep(tick: Tick) -> None:
        if tick.inside is not None:
            rows.append(row(tick.now, tick.inside, bundle.table.states, kind))
        if record is not None:
            record(tick)

    daemon = Daemon(bundle, settings, operator)
    prepare(daemon)
    listener = TickListener(daemon, keep)
    period_ms = daemon.period // 1_000_000
    began = time.perf_counter()
    datagrams: list[bytes] = []
    while not daemon.finished:
        now = emulator.now_ms * 1_000_000
        answer = daemon.tick(now, datagrams)
        listener.observe(now, datagrams, answer)
        datagrams = _period(emulator, answer, period_ms)
        if daemon.policy_ran:
            progress(now / NS)
    for _ in range(int(daemon.interface.farewell * NS / daemon.period)):
        _period(emulator, daemon.damping(), period_ms)
    if daemon.fault:
        emulator.advance(int(AFTERMATH * 1000), emulator.now_ms * 1_000_000)
    wall = time.perf_counter() - began
    return Outcome(
        report=RunReport.of(daemon.report(), _loop_report(emulator, daemon), record=None),
        log=rows,
        truth=emulator.truth(),
        realtime_factor=emulator.now_ms / 1000 / wall,
    )


def _loop_report(emulator: Emulator, daemon: Daemon) -> LoopReport:
    """Without times: there is no real time here."""
    interface = daemon.interface
    return LoopReport(
        tick_us=None,
        wake_us=None,
        rss_mb=None,
        timekeeping=None,
        packets=PacketReport(
            sent=emulator.to_robot.sent,
            received=interface.received,
            rejected=interface.rejected,
            lost=interface.lost,
        ),
    )


def _period(emulator: Emulator, command: bytes, milliseconds: int) -> list[bytes]:
    """Let a control period pass, with the network's faults; returns what reaches the daemon."""
    emulator.to_robot.send(command, emulator.now_ms)
    for _ in range(milliseconds):
        for datagram, _ in emulator.to_robot.arrived(emulator.now_ms):
            emulator.receive(datagram)
        emulator.advance(1, emulator.now_ms * 1_000_000)
    emulator.from_robot.send(emulator.state_datagram(), emulator.now_ms)
    return [datagram for datagram, _ in emulator.from_robot.arrived(emulator.now_ms)]
