"""The command ``rmll-gait``: check gaits before training, and show what they look like."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from rmll_common.command_line import run
from rmll_common.errors import InputError
from rmll_common.flag import within
from rmll_common.output_file import output_file
from rmll_gaits.compile import compile_gait
from rmll_gaits.label import FEET
from rmll_gaits.lint import Finding, lint
from rmll_gaits.load import load_gait, load_spec
from rmll_gaits.pose import PAPER_FEET
from rmll_gaits.schedule import POLICY_HZ, Schedule, schedule
from rmll_gaits.table import MachineTable
from rmll_view import terminal
from rmll_view.console import console
from rmll_view.contact_diagram import draw_contacts, draw_states
from rmll_view.machine_diagram import draw_machine

Gaits = Annotated[tuple[str, ...], tyro.conf.Positional]
Gait = Annotated[str, tyro.conf.Positional]


def main() -> None:
    """Entry point of ``rmll-gait``."""
    run("rmll-gait", {"check": check, "show": show})


def check(gaits: Gaits, *, frequency: float | None = None, json: bool = False) -> int:
    """Check gaits, and print their period and each foot's share of it on the ground.

    Example: rmll-gait check trot my/gallop.yaml --frequency 8

    Args:
        gaits: names from the library, or YAML files.
        frequency: c_f in policy steps; the middle of each gait's range if not given.
        json: print one JSON object and nothing else.

    Returns:
        2 if any gait has an error, else 0.
    """
    if not gaits:
        raise InputError("expected a gait to check, a name or a YAML file")
    findings = {gait: _findings(gait) for gait in gaits}
    failed = {gait for gait, found in findings.items() if any(f.level == "error" for f in found)}
    plans = {gait: _plan(load_gait(gait), frequency) for gait in gaits if gait not in failed}
    if json:
        _print_json(_report(findings, plans))
    else:
        _print_report(findings, plans)
    return 2 if failed else 0


def show(
    gait: Gait,
    *,
    frequency: float | None = None,
    svg: Path | None = None,
    png: Path | None = None,
    json: bool = False,
) -> None:
    """Show a gait's automaton and its expected foot contacts, in the terminal or as a picture.

    Example: rmll-gait show half_bound --png half_bound.png

    Args:
        gait: a name from the library, or a YAML file.
        frequency: c_f in policy steps; the middle of the gait's range if not given.
        svg: draw into this .svg file instead, or into GAIT.svg in this folder.
        png: draw into this .png file instead, or into GAIT.png in this folder.
        json: print the compiled table as one JSON object and nothing else.
    """
    spec = load_spec(gait)
    table = compile_gait(spec)
    plan = _plan(table, frequency)
    if svg or png:
        wanted = (("svg", svg), ("png", png))
        paths = [
            output_file(f"--{kind}", path, f"{spec.gait}.{kind}", f".{kind}")
            for kind, path in wanted
            if path
        ]
        picture = figure(table, plan, f"{spec.gait}: {spec.description}".rstrip(": "))
        for path in paths:
            picture.savefig(path, dpi=150)
    if json:
        _print_json(table.to_dict())
    elif not (svg or png):
        screen = console()
        screen.print(Text(spec.gait, "bold"), spec.description, sep="  ")
        screen.print(terminal.machine(table))
        screen.print(terminal.contacts(table, plan, screen.width))


def figure(table: MachineTable, plan: Schedule, title: str) -> Figure:
    """The automaton beside two cycles of expected foot contacts, one of them set off."""
    picture = Figure(figsize=(12, 4.6), layout="constrained")
    picture.suptitle(title, parse_math=False)
    panels = picture.subplot_mosaic(
        [["machine", "feet"], ["machine", "states"]], width_ratios=(1, 1.5), height_ratios=(5, 1)
    )
    draw_machine(panels["machine"], table)
    order = np.tile(np.repeat(np.arange(len(plan.steps)), plan.steps), 2)
    labels = np.array([phase.label for phase in plan.phases])[order]
    down = (labels[:, None] >> np.arange(len(FEET)) & 1).astype(bool)
    states = np.array([phase.state for phase in plan.phases])[order]
    times = np.arange(len(order)) / POLICY_HZ
    draw_contacts(panels["feet"], times, down, highlight=(0, plan.period))
    draw_states(panels["states"], times, states, table.states)
    panels["feet"].set_xticks([])
    panels["states"].set_xlabel("time [s]")
    return picture


def _findings(gait: str) -> list[Finding]:
    try:
        return lint(load_spec(gait))
    except InputError as error:
        return [Finding("error", str(error))]


def _plan(table: MachineTable, frequency: float | None) -> Schedule:
    if frequency is None:
        frequency = sum(table.commands.frequency) / 2
    within("frequency", frequency, 1, 1000)
    return schedule(table, frequency)


def _report(findings: dict[str, list[Finding]], plans: dict[str, Schedule]) -> dict[str, Any]:
    report: dict[str, Any] = {}
    for gait, found in findings.items():
        report[gait] = {"findings": [finding._asdict() for finding in found]}
        if plan := plans.get(gait):
            report[gait] |= {"period": plan.period, "steps": plan.steps, "duty": plan.duty}
    return report


def _print_report(findings: dict[str, list[Finding]], plans: dict[str, Schedule]) -> None:
    messages = console(stderr=True)
    colours = {"error": "bold red", "warning": "yellow"}
    for finding in (finding for found in findings.values() for finding in found):
        line = Text.assemble((finding.level, colours[finding.level]), f": {finding.message}")
        messages.print(line, soft_wrap=True)
    if not plans:
        return
    rows = Table(box=None, padding=(0, 2, 0, 0))
    rows.add_column("gait", overflow="fold")  # a long path is not cut
    for head in ("period [steps]", "period [s]", *(f"duty {foot}" for foot in PAPER_FEET)):
        rows.add_column(head, justify="right")
    for gait, plan in plans.items():
        duty = (f"{share:.2f}" for share in plan.duty.values())
        rows.add_row(gait, str(plan.period_steps), f"{plan.period:.2f}", *duty)
    console().print(rows)


def _print_json(data: Mapping[str, object]) -> None:
    print(json.dumps(data))
