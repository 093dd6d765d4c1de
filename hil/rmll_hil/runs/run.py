"""``rmll-hil run``: stand up, walk, sit down; figures on the screen and a folder with the rest."""

import json
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
from msgspec.structs import replace
from rich.progress import TimeRemainingColumn

from rmll_common.errors import Failure, InputError
from rmll_gaits.table import nearest
from rmll_hil.robot.can_robot import CanRobot
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.fault_plan import Plan, load_plan
from rmll_hil.robot.serve_can import on_free_ports
from rmll_hil.runs import lockstep, metrics, realtime_run, run_folder, sweep
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.control.controller import prove
from rmll_onboard.control.shipped_policies import find_policy
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.mcap_writer import log_file
from rmll_onboard.runtime.report_text import report_text
from rmll_onboard.settings import runtime_settings as onboard
from rmll_view.console import bar

LOG = "run.mcap"
"""The flight recorder's file in a run's folder"""
USUAL_SPEED = 0.5
"""[m/s] where nobody chose one"""


def run(
    policy: Path,
    seconds: float,
    vx: float | None,
    wz: float | None,
    frequency: tuple[float, ...] | None,
    settings: EmulatorSettings,
    daemon: onboard.RuntimeSettings,
    in_lockstep: bool,
    faults: Path | None,
    print_json: bool,
    out: Path | None,
) -> None:
    """Arguments as the command's. Raises Failure, after all is printed, if the robot faulted, got
    stuck, or fell on a machine that is too busy to judge it."""
    settings.check()
    policy = find_policy(policy)
    bundle = load_bundle(policy)
    plan = load_plan(faults, bundle.robot) if faults else ()
    if plan and daemon.link.kind != "udp":
        raise InputError("--faults: a fault plan needs --link udp")
    prove(bundle)
    commands = bundle.table.commands
    vx = nearest(USUAL_SPEED, commands.vx) if vx is None else vx
    operator = FlagOperator(commands, vx, wz, frequency, seconds)
    folder = run_folder.folder(out, bundle.contract.gait)
    try:
        with _progress(bundle.contract.gait, seconds) as progress:
            if in_lockstep:
                outcome = _lockstep(
                    bundle, operator, settings, daemon, plan, folder / LOG, progress
                )
            else:
                outcome = _realtime(
                    policy, operator, settings, daemon, faults, folder / LOG, progress
                )
    except KeyboardInterrupt:
        shutil.rmtree(folder)
        raise
    except BaseException:
        with suppress(OSError):  # a log of what went wrong stays
            folder.rmdir()
        raise
    summary = metrics.summary(outcome, bundle.contract.gait, bundle.robot)
    pace = " ".join(f"{value:g}" for value in operator.frequencies)
    title = f"{bundle.contract.gait}, {operator.vx:g} m/s, {operator.wz:g} rad/s, c_f {pace}"
    if len(operator.frequencies) > 1:
        found = sweep.phases(outcome, bundle.table, operator.frequencies, seconds)
        summary = replace(summary, phases=found)
        if found:
            sweep.draw(folder / "frequency.png", outcome, found, title)
    run_folder.write(folder, outcome, summary, bundle.table, title)
    entries = msgspec.to_builtins(summary)
    if print_json:
        print(json.dumps(entries))
    else:
        print(report_text({n: value for n, value in entries.items() if value not in (None, ())}))
    print(f"{folder}: {outcome.realtime_factor:.2f} x real time", file=sys.stderr)
    fault = outcome.report.fault
    trouble = fault and f"the robot went into damping: {fault}"
    if summary.stuck and not fault:
        trouble = f"the robot stopped walking by itself: {'; '.join(outcome.report.warnings)}"
    if not in_lockstep and not plan and (trouble or summary.falls):
        busy = realtime_run.too_busy(outcome.report)
        trouble = f"{busy} ({trouble or 'the robot fell'})" if busy else trouble
    if trouble:
        raise Failure(trouble)


def _lockstep(
    bundle: Bundle,
    operator: FlagOperator,
    settings: EmulatorSettings,
    daemon: onboard.RuntimeSettings,
    plan: Plan,
    record: Path,
    progress: Callable[[float], None],
) -> Outcome:
    wire = CanRobot(daemon.can, bundle.robot) if daemon.link.kind == "can" else None
    emulator = Emulator(settings, robot=bundle.robot, plan=plan, wire=wire)
    about = describe(bundle, daemon, real_time=False)
    with log_file(record, about) as log:
        return lockstep.walk(emulator, bundle, operator, progress, log.add, daemon)


def _realtime(
    policy: Path,
    operator: FlagOperator,
    settings: EmulatorSettings,
    daemon: onboard.RuntimeSettings,
    faults: Path | None,
    record: Path,
    progress: Callable[[float], None],
) -> Outcome:
    values = {"vx": operator.vx, "wz": operator.wz, "seconds": operator.seconds}
    flags = [text for name, value in values.items() for text in (f"--{name}", str(value))]
    flags += ["--frequency", *map(str, operator.frequencies)]
    onboard_flags = ["--policy", str(policy), *flags]
    if daemon.link.kind == "can":
        daemon = replace(daemon, can=on_free_ports(daemon.can))
    return realtime_run.walk(onboard_flags, settings, record, progress, faults, daemon)


@contextmanager
def _progress(gait: str, seconds: float) -> Iterator[Callable[[float], None]]:
    """A bar on stderr; the robot's way up and down are part of it."""
    motion = onboard.Motion()
    up, down = motion.crouch + motion.rise + motion.settle, motion.slow_down + motion.sit
    total = up + seconds + down
    with bar(TimeRemainingColumn()) as progress:
        task = progress.add_task(gait, total=total)
        yield lambda seconds: progress.update(task, completed=seconds)
