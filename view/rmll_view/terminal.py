"""A gait in the terminal: its edges as a table, its feet as bars of one character a step."""

import math
from itertools import groupby

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rmll_gaits.pose import BITS, PAPER_FEET
from rmll_gaits.schedule import Schedule
from rmll_gaits.table import MachineTable
from rmll_view.arcs import Pattern, arcs
from rmll_view.palette import FOOT_COLOURS, REJECT, state_colour

CYCLES = 3
"""Shown at most; fewer where the terminal is narrow"""


def machine(table: MachineTable) -> RenderableType:
    """The automaton, a row an arc: ● in contact, ○ in the air, · either."""
    rows = Table("from", " ".join(PAPER_FEET), "when", "to", box=None, padding=(0, 2, 0, 0))
    for arc in arcs(table):
        source = table.states[arc.source] + (" (start)" if arc.source == table.start else "")
        target = table.states[arc.target] + (" (sink)" if arc.rejects else "")
        feet = Text("\n").join(map(_feet, arc.patterns))
        rows.add_row(source, feet, arc.condition, target, style=REJECT if arc.rejects else "")
    return rows


def contacts(table: MachineTable, plan: Schedule, width: int) -> RenderableType:
    """The expected foot contacts and states over some cycles, at most ``width`` columns."""
    room = max(1, width - 8)
    squeeze = math.ceil(plan.period_steps / room)
    cycles = min(CYCLES, max(1, room * squeeze // plan.period_steps))
    phases = np.tile(np.repeat(np.arange(len(plan.steps)), plan.steps), cycles)[::squeeze]
    rows = Table.grid(padding=(0, 2, 0, 0))
    for foot in PAPER_FEET:
        down = [bool(plan.phases[phase].label & BITS[foot]) for phase in phases]
        bar = "".join("█" if touching else "·" for touching in down)
        rows.add_row(foot, Text(bar, FOOT_COLOURS[foot], no_wrap=True))
    rows.add_row("state", _ribbon(table, plan, phases.tolist()))
    return Group(rows, Text(f"{cycles} cycles, a column is {squeeze * 20} ms", "dim"))


def _feet(pattern: Pattern) -> Text:
    glyphs = {True: "●", False: "○", None: "·"}
    text = Text()
    for foot, down in zip(PAPER_FEET, pattern, strict=True):
        text.append(f"{glyphs[down]:<3}", FOOT_COLOURS[foot])
    return text


def _ribbon(table: MachineTable, plan: Schedule, phases: list[int]) -> Text:
    """State names, each at the beginning of its stretch, on the state's colour."""
    text = Text(no_wrap=True)
    for phase, stretch in groupby(phases):
        state, length = plan.phases[phase].state, len(list(stretch))
        name = f"{table.states[state]:<{length}}"[:length]
        text.append(name, f"black on {state_colour(state)}")
    return text
