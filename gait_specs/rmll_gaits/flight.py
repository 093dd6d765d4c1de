"""Flights that a gait asks for and no robot of a dog's size can make."""

from collections.abc import Iterator

import numpy as np

from rmll_gaits import pose
from rmll_gaits.schedule import POLICY_HZ, Schedule, schedule
from rmll_gaits.table import ADVANCE, MachineTable

GRAVITY = 9.81
HIGHEST_HOP = 0.15
"""[m] that a body rises in a flight; an A1 stands 0.3 m high"""
HEAVIEST = 1.2
"""Robot's weights that each foot in contact bears, on the average of a cycle with a flight. An A1's
knee of 33.5 N·m bears 1.7 at the peak of a step, with the foot 0.16 m beside it"""


def flights(table: MachineTable) -> Iterator[str]:
    """What to say of the first flight of the main cycle that cannot be; nothing if all can."""
    for frequency in dict.fromkeys(table.commands.frequency):
        plan = schedule(table, frequency)
        for index in range(len(plan.phases)):
            if _in_the_air(table, plan, index) and (why := _impossible(plan, index)):
                yield f"at frequency {frequency:g} {why}; {_remedy(plan, index)}"
                return


def _in_the_air(table: MachineTable, plan: Schedule, index: int) -> bool:
    """Only a robot without a foot down can enter this phase."""
    before, here = plan.phases[index - 1].state, plan.phases[index].state
    leads = (table.effect[before] == ADVANCE) & (table.next_state[before] == here)
    return np.flatnonzero(leads).tolist() == [0]


def _impossible(plan: Schedule, index: int) -> str:
    seconds = plan.steps[index] / POLICY_HZ
    lasts = f"pose {pose.NO_FEET} lasts {seconds:.2f} s"
    hop = GRAVITY * seconds**2 / 8
    if hop > HIGHEST_HOP:
        return f"{lasts}, a hop of {hop:.2f} m"
    feet = sum(plan.duty.values())
    if feet * HEAVIEST < 1:
        load = f"each foot in contact bears {1 / feet:.1f} times" if feet else "no foot bears"
        return f"{lasts} of each {plan.period:.2f} s, so {load} the robot's weight"
    return ""


def _remedy(plan: Schedule, index: int) -> str:
    """Whose dwell it is, which is easily taken for the other one."""
    before, here, after = (plan.phases[(index + hop) % len(plan.phases)] for hop in (-1, 0, 1))
    following, preceding = pose.to_text(after.label), pose.to_text(before.label)
    return (
        f"the dwell at the pose after it, {following}, says how long ({here.dwell:g}),"
        f" its own ({before.dwell:g}) how long {preceding} lasts;"
        f" write a smaller dwell at {following}"
    )
