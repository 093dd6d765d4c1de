"""``rmll-hil run``: stand up, walk, sit down; figures on the screen and a folder with the rest."""

import json
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from rmll_gaits.errors import Failure
from rmll_hil import lockstep, metrics, realtime, results
from rmll_hil.emulator import Emulator, Settings
from rmll_hil.outcome import Outcome
from rmll_onboard.bundle import load_bundle
from rmll_onboard.controller import prove
from rmll_onboard.pilot import FlagPilot
from rmll_onboard.settings import Motion

WALL_CLOCK = ("realtime_factor", "tick_us", "wake_us", "rss_mb")
"""Figures of the machine and not of the robot; None in lockstep, so that equal runs print equal"""


def run(
    policy: Path,
    seconds: float,
    vx: float,
    wz: float,
    frequency: float | None,
    settings: Settings,
    in_lockstep: bool,
    print_json: bool,
    out: Path | None,
) -> None:
    """Arguments as the command's. Raises Failure, after all is printed, if the robot faulted."""
    settings.check()
    bundle = load_bundle(policy)
    prove(bundle)
    pilot = FlagPilot(bundle.table.commands, vx, wz, frequency, seconds)
    folder = results.folder(out, bundle.contract.gait)
    messages = Console(stderr=True)
    try:
        with _progress(messages, bundle.contract.gait, seconds) as progress:
            if in_lockstep:
                emulator = Emulator(settings, robot=bundle.robot)
                outcome = lockstep.walk(emulator, bundle, pilot, progress)
            else:
                outcome = _realtime(policy, pilot, settings, progress)
    except BaseException:
        folder.rmdir()
        raise
    summary = metrics.summary(outcome, bundle.contract.gait, bundle.robot)
    if in_lockstep:
        summary |= dict.fromkeys(WALL_CLOCK)
    title = f"{bundle.contract.gait}, {vx:g} m/s, {wz:g} rad/s, c_f {pilot.command[2]:g}"
    results.write(folder, outcome, summary, bundle.table, title)
    if print_json:
        print(json.dumps(summary))
    else:
        _show(summary)
    messages.print(f"{folder}: {outcome.realtime_factor:.2f} x real time", highlight=False)
    if outcome.report["fault"]:
        raise Failure(f"the robot went into damping: {outcome.report['fault']}")


def _realtime(
    policy: Path, pilot: FlagPilot, settings: Settings, progress: Callable[[float], None]
) -> Outcome:
    names = ("vx", "wz", "frequency", "seconds")
    values = zip(names, (*pilot.command, pilot.seconds), strict=True)
    flags = [text for name, value in values for text in (f"--{name}", str(value))]
    with tempfile.TemporaryDirectory(prefix="rmll-hil-") as scratch:
        return realtime.walk(["--policy", str(policy), *flags], settings, Path(scratch), progress)


@contextmanager
def _progress(messages: Console, gait: str, seconds: float) -> Iterator[Callable[[float], None]]:
    """A bar on stderr; the robot's way up and down are part of it."""
    motion = Motion()
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
        if value is not None:
            table.add_row(name, _plain(value))
    Console().print(table, highlight=False)


def _plain(value: Any) -> str:
    if isinstance(value, dict):
        return "  ".join(f"{name} {_plain(inner)}" for name, inner in value.items())
    return f"{value:.3g}" if isinstance(value, float) else str(value)
