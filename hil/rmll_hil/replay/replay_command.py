"""``rmll-hil replay``: a log through today's daemon, and what came out."""

import json
from dataclasses import asdict
from pathlib import Path

from rich.progress import TextColumn
from rich.table import Table

from rmll_common.errors import Failure
from rmll_hil.replay.replay import Difference, Replay, find_bundle, replay
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.shipped_policies import find_policy
from rmll_onboard.recording.flight_log import FlightLog, missing
from rmll_view.console import bar, console

SHOWN = 12
"""Fields of a difference that are shown; --json has them all"""


def replay_command(log: Path, policy: Path | None, policies: Path, print_json: bool) -> None:
    """Arguments as the command's. Raises Failure, after all is printed, unless all is the same."""
    flight = FlightLog(log)
    path = find_policy(policy) if policy else find_bundle(flight, policies)
    bundle = load_bundle(path)
    why = "as named" if policy else "the shipped one, with which it was recorded"
    console(stderr=True).print(f"taken: {path}, {why}", soft_wrap=True)
    with bar(TextColumn("{task.completed} ticks", markup=False)) as progress:
        task = progress.add_task("replay", total=None)
        found = replay(flight, bundle, lambda ticks: progress.update(task, completed=ticks))
    if print_json:
        print(json.dumps(asdict(found) | {"identical": found.identical}))
    else:
        _show(found)
    if not found.identical:
        raise Failure(_verdict(found))


def _show(found: Replay) -> None:
    screen = console()
    screen.print(f"{found.ticks} ticks, {found.seconds:.2f} s, {found.different} different")
    if not found.complete:
        screen.print("the log was cut short; what is in it was replayed")
    for line in missing(found.gaps, found.lost):
        screen.print(line, soft_wrap=True)
    if found.first:
        screen.print(_table(found.first))
        for remark in found.remarks:
            screen.print(remark, soft_wrap=True)


def _table(first: Difference) -> Table:
    title = f"first difference: tick {first.tick}, {first.seconds:.3f} s, {first.mode}"
    table = Table("field", "recorded", "replayed", title=title, box=None)
    for field in first.fields[:SHOWN]:
        table.add_row(field.name, field.recorded, field.replayed)
    if len(first.fields) > SHOWN:
        table.caption = f"and {len(first.fields) - SHOWN} more"
    return table


def _verdict(found: Replay) -> str:
    verdict = []
    if found.first:
        verdict.append(
            f"{found.different} of {found.ticks} datagrams differ, first at tick {found.first.tick}"
        )
    if found.missing is not None:
        told = f"; {found.not_compared} ticks after it were not compared" * bool(found.not_compared)
        verdict.append(f"tick {found.missing} is missing in the log, the replay ends there{told}")
    return "; ".join(verdict + (found.remarks if found.first else []))
