"""``rmll-eval conformance``: does a recorded walk keep to its gait?"""

import sys
from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table
from rich.text import Text

from rmll_common.output_file import output_file
from rmll_eval.conformance import Conformance, RecordedWalk, walks
from rmll_eval.conformance import conformance as judge
from rmll_gaits.table import MachineTable
from rmll_hil.runs import run_folder
from rmll_onboard.recording.flight_log import FlightLog, missing
from rmll_view.console import console
from rmll_view.contact_diagram import contact_figure

SHOWN = 6
"""Kinds of off-spec contact that are listed; --json has them all"""


def conformance(
    log: Annotated[Path, tyro.conf.Positional],
    *,
    json: bool = False,
    out: Path | None = None,
) -> None:
    """Put a log's contact labels through the automaton of its gait: rate, dwell, adherence.

    Takes what rmll-onboard --record and rmll-hil run leave. All policy steps count, those on the
    spot before the robot stands still too.

    Example: rmll-eval conformance hil-runs/trot-20250101-120000/run.mcap

    Args:
        log: The .mcap file.
        json: Print one JSON object.
        out: Picture to write, contacts over states, or a folder for it; a new file in hil-runs/
            by default.
    """
    out = out and output_file("--out", out, "conformance.png", ".png")
    flight = FlightLog(log)
    table = flight.about.machine_table()
    found = walks(flight)
    judged = judge(found, table)
    if json:
        gaps = [asdict(gap) for gap in flight.gaps]
        print(dumps(asdict(judged) | {"gaps": gaps, "lost": flight.lost}))
    else:
        _show(judged)
        for line in missing(flight.gaps, flight.lost):
            print(line)
    target = out or run_folder.folder(None, f"{table.gait}-conformance") / "conformance.png"
    _picture(target, max(found, key=lambda walk: len(walk.times)), table, judged)
    print(target, file=sys.stderr)


def _picture(path: Path, walk: RecordedWalk, table: MachineTable, judged: Conformance) -> None:
    """The longest walk."""
    title = (
        f"{judged.gait}, c_f {judged.frequency:.3g}: adherence {judged.adherence:.2f}, "
        f"{judged.off_spec_contact:.0%} off-spec"
    )
    times = walk.times - walk.times[0]
    contact_figure(path, times, walk.down, walk.states, table, walk.off_spec, title)


def _show(judged: Conformance) -> None:
    screen = console()
    rate = "-" if judged.cycle_rate is None else f"{judged.cycle_rate:.2f}"
    entries = {
        "gait": judged.gait,
        "walked [s]": f"{judged.seconds:.1f}",
        "c_f [policy steps]": f"{judged.frequency:.3g}",
        "adherence": f"{judged.adherence:.3f}",
        "full cycles": str(judged.cycles),
        "cycle rate [Hz]": f"{rate}, at most {judged.cycle_rate_allowed:.2f} by c_f",
        "off-spec contact": f"{judged.off_spec_contact:.3f}",
    }
    if judged.contradictions:
        entries["contradictions"] = f"{judged.contradictions} steps in another state than recorded"
    summary = Table(show_header=False, box=None)
    for name, value in entries.items():
        summary.add_row(Text(name, "bold"), value)
    screen.print(summary, "")
    screen.print(_dwell(judged))
    for name, count in list(judged.off_spec_steps.items())[:SHOWN]:
        screen.print(f"off-spec in {name}, {count} steps")


def _dwell(judged: Conformance) -> Table:
    table = Table("state", box=None, padding=(0, 2, 0, 0))
    for head in ("visits", "least", "mean", "most", "c_f allows"):
        table.add_column(head, justify="right")
    table.title = Text("policy steps spent in a state", "bold")
    for name, dwell in judged.dwell.items():
        allowed = "-" if dwell.allowed is None else str(dwell.allowed)
        figures = dwell.visits, dwell.least, f"{dwell.mean:.1f}", dwell.most, allowed
        table.add_row(name, *map(str, figures))
    return table
