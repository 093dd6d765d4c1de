"""``rmll-hil run``: stand up, walk, sit down; figures on the screen and a folder with the rest."""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from msgspec.structs import replace
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from rmll_gaits.errors import Failure, InputError
from rmll_gaits.table import nearest
from rmll_hil import lockstep, metrics, realtime, results, sweep
from rmll_hil.can_robot import CanRobot
from rmll_hil.emulator import Emulator, Settings
from rmll_hil.faults import Plan, load_plan
from rmll_hil.outcome import Outcome
from rmll_hil.serve_can import on_free_ports
from rmll_onboard import settings as onboard
from rmll_onboard.about import describe
from rmll_onboard.bundle import Bundle, load_bundle
from rmll_onboard.controller import prove
from rmll_onboard.mcap_file import log_file
from rmll_onboard.pilot import FlagPilot

LOG = "run.mcap"
"""The flight recorder's file in a run's folder"""
USUAL_SPEED = 0.5
"""[m/s] where nobody chose one"""
WALL_CLOCK = ("realtime_factor", "tick_us", "wake_us", "rss_mb", "pace")
"""Figures of the machine and not of the robot; None in lockstep, so that equal runs print equal"""


def run(
    policy: Path,
    seconds: float,
    vx: float | None,
    wz: float | None,
    frequency: tuple[float, ...] | None,
    settings: Settings,
    daemon: onboard.Settings,
    in_lockstep: bool,
    faults: Path | None,
    print_json: bool,
    out: Path | None,
) -> None:
    """Arguments as the command's. Raises Failure, after all is printed, if the robot faulted."""
    settings.check()
    bundle = load_bundle(policy)
    plan = load_plan(faults, bundle.robot) if faults else ()
    if plan and daemon.link.kind != "udp":
        raise InputError("--faults: a fault plan needs --link udp")
    prove(bundle)
    commands = bundle.table.commands
    vx = nearest(USUAL_SPEED, commands.vx) if vx is None else vx
    pilot = FlagPilot(commands, vx, wz, frequency, seconds)
    folder = results.folder(out, bundle.contract.gait)
    messages = Console(stderr=True)
    try:
        with _progress(messages, bundle.contract.gait, seconds) as progress:
            if in_lockstep:
                outcome = _lockstep(bundle, pilot, settings, daemon, plan, folder / LOG, progress)
            else:
                outcome = _realtime(policy, pilot, settings, daemon, faults, folder / LOG, progress)
    except KeyboardInterrupt:
        shutil.rmtree(folder)
        raise
    except BaseException:
        with suppress(OSError):  # a log of what went wrong stays
            folder.rmdir()
        raise
    summary = metrics.summary(outcome, bundle.contract.gait, bundle.robot)
    if in_lockstep:
        summary |= dict.fromkeys(WALL_CLOCK)
    pace = " ".join(f"{value:g}" for value in pilot.frequencies)
    title = f"{bundle.contract.gait}, {pilot.vx:g} m/s, {pilot.wz:g} rad/s, c_f {pace}"
    if len(pilot.frequencies) > 1:
        found = sweep.phases(outcome, bundle.table, pilot.frequencies, seconds)
        summary["phases"] = found
        if found:
            sweep.draw(folder / "frequency.png", outcome, found, title)
    results.write(folder, outcome, summary, bundle.table, title)
    if print_json:
        print(json.dumps(summary))
    else:
        _show(summary)
    messages.print(f"{folder}: {outcome.realtime_factor:.2f} x real time", highlight=False)
    if outcome.report["fault"]:
        raise Failure(f"the robot went into damping: {outcome.report['fault']}")


def _lockstep(
    bundle: Bundle,
    pilot: FlagPilot,
    settings: Settings,
    daemon: onboard.Settings,
    plan: Plan,
    record: Path,
    progress: Callable[[float], None],
) -> Outcome:
    wire = CanRobot(daemon.can, bundle.robot) if daemon.link.kind == "can" else None
    emulator = Emulator(settings, robot=bundle.robot, plan=plan, wire=wire)
    about = describe(bundle, daemon, real_time=False)
    with log_file(record, about) as log:
        return lockstep.walk(emulator, bundle, pilot, progress, log.add, daemon)


def _realtime(
    policy: Path,
    pilot: FlagPilot,
    settings: Settings,
    daemon: onboard.Settings,
    faults: Path | None,
    record: Path,
    progress: Callable[[float], None],
) -> Outcome:
    values = {"vx": pilot.vx, "wz": pilot.wz, "seconds": pilot.seconds}
    flags = [text for name, value in values.items() for text in (f"--{name}", str(value))]
    flags += ["--frequency", *map(str, pilot.frequencies)]
    onboard_flags = ["--policy", str(policy), *flags]
    if daemon.link.kind == "can":
        daemon = replace(daemon, can=on_free_ports(daemon.can))
    return realtime.walk(onboard_flags, settings, record, progress, faults, daemon)


@contextmanager
def _progress(messages: Console, gait: str, seconds: float) -> Iterator[Callable[[float], None]]:
    """A bar on stderr; the robot's way up and down are part of it."""
    motion = onboard.Motion()
    up, down = motion.crouch + motion.rise + motion.settle, motion.slow_down + motion.sit
    total = up + seconds + down
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=messages, transient=True) as bar:
        task = bar.add_task(gait, total=total)
        yield lambda seconds: bar.update(task, completed=seconds)


def _show(summary: dict[str, Any]) -> None:
    table = Table(show_header=False, box=None)
    table.add_column(style="bold")
    table.add_column(justify="right")
    for name, value in summary.items():
        if value not in (None, []):
            table.add_row(name, _plain(value))
    Console().print(table, highlight=False)


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return "\n".join(map(_plain, value))
    if isinstance(value, dict):
        return "  ".join(f"{name} {_plain(inner)}" for name, inner in value.items())
    return f"{value:.3g}" if isinstance(value, float) else str(value)
