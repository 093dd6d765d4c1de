"""An automaton as a picture: states on a circle, guards as robots seen from above.

A foot is a disc at its corner of the body, the head points up: filled when the foot has to be
in contact, hollow when it has to be in the air, a grey point when it may be either.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Polygon
from numpy.typing import NDArray

from rmll_gaits.pose import PAPER_FEET
from rmll_gaits.table import MachineTable
from rmll_view.arcs import Arc, Pattern, arcs
from rmll_view.palette import FOOT_COLOURS, INK, MUTED, PAPER, REJECT, state_colour

Point = NDArray[np.float64]

# Lengths in units of the axes; the states stand on a circle of radius 1 or more.
NODE_RADIUS = 0.19
BODY = (0.13, 0.2)
FOOT_RADIUS = 0.045
PITCH = 0.34
"""From one pattern of a guard to the next"""
BEND = 0.28
"""Height of an arc over its chord, as a share of the chord"""
GAP = 0.24
"""From an arc to the middle of its guard"""

_ROTATION = np.array([[0.77, -0.64], [0.64, 0.77]])

LEGEND = (
    "filled: in contact, hollow: in the air, point: either\n"
    "φ: policy steps since the last edge, N: frequency"
)


def draw_machine(axes: Axes, table: MachineTable) -> None:
    """Draw the automaton; the sink, if there is one, stands in the middle."""
    places = _places(table)
    nodes = [_draw_state(axes, table, state, place) for state, place in enumerate(places)]
    ring = table.num_states - (table.sink is not None)
    for arc in arcs(table):
        apart = abs(arc.source - arc.target)
        _draw_arc(axes, arc, nodes, places, across=not arc.rejects and 1 < apart < ring - 1)
    _draw_start(axes, places[table.start], nodes[table.start])
    axes.set_aspect("equal")
    axes.update_datalim([(-1.4, -1.4), (1.4, 1.4)])  # one state alone should not fill the picture
    axes.margins(0.06)
    axes.autoscale_view()
    axes.axis("off")
    axes.text(0.5, 0, LEGEND, transform=axes.transAxes, ha="center", va="top", size=7, color=INK)


def _places(table: MachineTable) -> list[Point]:
    """Clockwise from the upper left, so that two states stand side by side and four in a square."""
    circling = [state for state in range(table.num_states) if state != table.sink]
    count = len(circling)
    radius = max(1.0, 0.3 * count)
    places = [np.zeros(2)] * table.num_states
    for i, state in enumerate(circling):
        angle = math.pi / 2 + math.pi / count - 2 * math.pi * i / count
        places[state] = radius * np.array([math.cos(angle), math.sin(angle)])
    return places


def _draw_state(axes: Axes, table: MachineTable, state: int, place: Point) -> Circle:
    sink = state == table.sink
    node = Circle(
        (place[0], place[1]),
        NODE_RADIUS,
        facecolor=PAPER if sink else state_colour(state),
        edgecolor=REJECT if sink else INK,
        linewidth=1.5,
        zorder=3,
    )
    axes.add_patch(node)
    name = table.states[state]
    size = max(6, 14 - len(name))
    axes.text(place[0], place[1], name, ha="center", va="center", size=size, color=INK, zorder=4)
    return node


def _draw_start(axes: Axes, place: Point, node: Circle) -> None:
    outward = _outward(place)
    tail = place + outward * (NODE_RADIUS + 0.3)
    arrow = FancyArrowPatch(
        (tail[0], tail[1]), (place[0], place[1]), patchB=node, arrowstyle="-|>", mutation_scale=14,
        color=INK, linewidth=1.5,
    )  # fmt: skip
    axes.add_patch(arrow)
    x, y = tail + outward * 0.16
    axes.text(x, y, "start", ha="center", va="center", size=9, color=INK)


def _draw_arc(
    axes: Axes, arc: Arc, nodes: list[Circle], places: list[Point], *, across: bool
) -> None:
    """The arrow and its guard; ``across`` is an arc between states that are no neighbours."""
    start, end = places[arc.source], places[arc.target]
    ends = nodes[arc.source], nodes[arc.target]
    bend = 0.0 if arc.rejects else BEND
    if arc.source == arc.target:
        start, end, bend, ends = *_loop(start), 4.0, (None, None)
    axes.add_patch(
        FancyArrowPatch(
            (start[0], start[1]), (end[0], end[1]), patchA=ends[0], patchB=ends[1], shrinkA=2,
            shrinkB=2, connectionstyle=f"arc3,rad={-bend}", arrowstyle="-|>", mutation_scale=14,
            color=REJECT if arc.rejects else INK, linestyle="--" if arc.rejects else "-",
            linewidth=1.2 if arc.rejects else 1.5,
        )
    )  # fmt: skip
    # The arc is a quadratic Bezier curve. Guards of arcs across the circle stand near the source,
    # so that they do not all meet in the middle.
    left = np.array([start[1] - end[1], end[0] - start[0]])
    control = (start + end) / 2 + bend * left
    t = 0.3 if across else 0.5
    middle = (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end
    normal = _unit(left)
    gap = GAP + abs(normal[0]) * PITCH * (len(arc.patterns) - 1) / 2
    _draw_guard(axes, arc, middle + gap * normal, above=normal[1] > 0.01)


def _loop(place: Point) -> tuple[Point, Point]:
    """Both ends of a loop on the outer side of a state, off the way of the start arrow."""
    outward = _outward(place) @ _ROTATION
    foot = place + 0.92 * NODE_RADIUS * outward
    side = 0.4 * NODE_RADIUS * np.array([outward[1], -outward[0]])
    return foot - side, foot + side


def _draw_guard(axes: Axes, arc: Arc, place: Point, *, above: bool) -> None:
    """Icons of the patterns, and the condition above or below them, away from the arc."""
    for i, pattern in enumerate(arc.patterns):
        shift = PITCH * (i - (len(arc.patterns) - 1) / 2)
        _draw_robot(axes, pattern, place + np.array([shift, 0]))
    colour = REJECT if arc.rejects else INK
    y = place[1] + (0.2 if above else -0.2)
    axes.text(place[0], y, arc.condition, ha="center", va="center", size=8, color=colour)


def _draw_robot(axes: Axes, pattern: Pattern, place: Point) -> None:
    width, length = BODY
    corner = place - np.array(BODY) / 2
    axes.add_patch(
        FancyBboxPatch(
            (corner[0], corner[1]), width, length, boxstyle="round,pad=0,rounding_size=0.04",
            facecolor="#eceff1", edgecolor=MUTED, linewidth=0.8, zorder=3,
        )
    )  # fmt: skip
    nose = place + np.array([[-0.03, 0.04], [0.03, 0.04], [0, 0.08]])
    axes.add_patch(Polygon(nose, facecolor=MUTED, zorder=4))
    corners = ((-1, 1), (1, 1), (-1, -1), (1, -1))
    for foot, down, at in zip(PAPER_FEET, pattern, corners, strict=True):
        x, y = place + np.array(at) * np.array([width / 2 + 0.02, length / 2])
        if down is None:
            axes.add_patch(Circle((x, y), FOOT_RADIUS / 3, facecolor=MUTED, zorder=4))
            continue
        colour = FOOT_COLOURS[foot]
        fill = colour if down else PAPER
        axes.add_patch(
            Circle((x, y), FOOT_RADIUS, facecolor=fill, edgecolor=colour, linewidth=1.2, zorder=4)
        )


def _outward(place: Point) -> Point:
    """From the middle of the drawing; upwards for a state in the middle."""
    return _unit(place) if place.any() else np.array([0.0, 1.0])


def _unit(vector: Point) -> Point:
    return vector / np.linalg.norm(vector)
