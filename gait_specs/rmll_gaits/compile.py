"""From a gait's rules to its table: what each contact label does in each state."""

import numpy as np

from rmll_common.errors import InputError
from rmll_gaits import pose
from rmll_gaits.label import NUM_LABELS
from rmll_gaits.problems import problems
from rmll_gaits.spec import SINK, GaitSpec
from rmll_gaits.table import ADVANCE, REJECT, MachineTable


def compile_gait(spec: GaitSpec) -> MachineTable:
    """The table of a gait; the sink, if any edge rejects, is its last state.

    Raises InputError with the first of :func:`rmll_gaits.problems.problems`.
    """
    for problem in problems(spec):
        raise InputError(problem)
    names = [state.name for state in spec.states] + [SINK] * spec.rejects
    shape = (len(names), NUM_LABELS)
    next_state = np.repeat(np.arange(len(names))[:, None], NUM_LABELS, axis=1)
    effect, dwell, grace = np.zeros(shape, int), np.zeros(shape), np.zeros(shape, int)
    for row, state in enumerate(spec.states):
        for edge in state.edges:
            columns = sorted(edge.labels)
            next_state[row, columns] = names.index(edge.to)
            effect[row, columns] = REJECT if edge.rejects else ADVANCE
            dwell[row, columns] = edge.dwell
            grace[row, columns] = edge.grace
    return MachineTable(
        gait=spec.gait,
        states=tuple(names),
        start=names.index(spec.start),
        sink=names.index(SINK) if spec.rejects else None,
        commands=spec.commands,
        next_state=next_state,
        effect=effect,
        dwell=dwell,
        grace=grace,
        hold=_hold(spec, names),
    )


def _hold(spec: GaitSpec, names: list[str]) -> np.ndarray:
    """Labels expected while waiting; nothing is expected in the sink."""
    hold = np.zeros((len(names), NUM_LABELS), bool)
    hold[names.index(spec.start), pose.ALL_DOWN] = True
    for state in spec.states:
        for edge in state.edges:
            if not edge.rejects:
                hold[names.index(edge.to), sorted(edge.labels)] = True
    for row, state in enumerate(spec.states):
        if state.hold is not None:
            hold[row] = np.isin(np.arange(NUM_LABELS), sorted(state.hold))
    return hold
