import numpy as np
import pytest
import torch

from rmll_common.errors import InputError
from rmll_gaits.compile import compile_gait
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.machine import Machine, step
from rmll_gaits.pose import to_text
from rmll_gaits.schedule import POLICY_HZ, main_cycle, mean_dwell, schedule, transition_rate
from rmll_gaits.spec import read_spec
from rmll_gaits.table import MachineTable
from rmll_robots import A1

HEAD = "gait: g\ncommands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}\n"


def compiled(body: str) -> MachineTable:
    return compile_gait(read_spec(HEAD + body, "g.yaml"))


def test_three_one_by_hand():
    plan = schedule(load_gait("three_one"), 9)
    poses = [to_text(phase.label) for phase in plan.phases]
    assert poses == ["FL BL BR", "FL", "FR BL BR", "FR"]
    # A pose lasts until the next edge opens: the half dwell belongs to the edge that ends it.
    assert plan.steps == (5, 9, 5, 9)
    assert plan.period == pytest.approx(0.56)
    assert plan.duty == {"FL": 0.5, "FR": 0.5, "BL": 10 / 28, "BR": 10 / 28}


@pytest.mark.parametrize("gait", library_names())
@pytest.mark.parametrize("frequency", [5, 6.5, 9, 12])
def test_the_automaton_walked_at_its_fastest_keeps_the_schedule(gait, frequency):
    table = load_gait(gait)
    machine, plan = Machine.of(table), schedule(table, frequency)
    state, phi, moments = table.start, 0, []
    following = plan.phases[1:] + plan.phases[:1]
    poses = {here.state: after.label for here, after in zip(plan.phases, following, strict=True)}
    for age in range(4 * plan.period_steps):
        at = step(machine, state, phi, poses[state], frequency, age)
        state, phi = int(at.state), int(at.phi)
        if at.advanced:
            moments.append(age)
    cycle = len(plan.steps)
    assert np.diff(moments)[:cycle].tolist() == list(plan.steps)
    assert np.diff(moments[::cycle]).tolist() == [plan.period_steps] * 3
    assert transition_rate(table, frequency) == pytest.approx(cycle / plan.period_steps)


@pytest.mark.parametrize("gait", library_names())
def test_rates_are_the_same_for_numbers_arrays_and_tensors(gait):
    table = load_gait(gait)
    frequencies = [5.0, 6.0, 7.3, 12.0]
    singly = [transition_rate(table, frequency) for frequency in frequencies]
    assert transition_rate(table, np.array(frequencies)).tolist() == singly
    tensor = transition_rate(table, torch.tensor(frequencies, dtype=torch.float64))
    assert tensor.tolist() == singly
    assert mean_dwell(table, 6.0) == pytest.approx(1 / transition_rate(table, 6.0))


def test_an_edge_without_dwell_still_takes_a_step():
    table = compiled("cycle: [FL, {feet: FR, dwell: 0}]")
    assert schedule(table, 6).steps == (1, 6)
    assert mean_dwell(table, torch.tensor([6.0])).tolist() == [3.5]


def test_a_branching_gait_reports_its_shortest_cycle():
    table = compiled(
        "states:\n"
        "  a:\n    - {when: FL & !FR, to: b}\n    - {when: FR & !FL, to: c, dwell: 2}\n"
        "  b:\n    - {when: BL, to: d}\n"
        "  c:\n    - {when: BR, to: a}\n"
        "  d:\n    - {when: BR, to: a}\n"
    )
    cycle = main_cycle(table)
    assert [table.states[phase.state] for phase in cycle] == ["c", "a"]
    assert [to_text(phase.label) for phase in cycle] == ["FR", "BR"]
    assert [phase.dwell for phase in cycle] == [1, 2]


def test_a_lead_in_is_not_part_of_the_cycle():
    table = compiled(
        "states:\n  lead: [{when: FL, to: a}]\n  a: [{when: FR, to: b}]\n  b: [{when: BL, to: a}]\n"
    )
    assert [table.states[phase.state] for phase in main_cycle(table)] == ["b", "a"]


def test_a_table_without_any_cycle_has_no_schedule():
    plain = load_gait("trot").to_dict()
    plain["effect"] = [[0] * 16] * 2
    plain["next_state"] = [[0] * 16, [1] * 16]
    with pytest.raises(InputError, match="no cycle"):
        main_cycle(MachineTable.from_dict(plain))


def test_periods_count_the_robot_s_policy_steps():
    assert A1.policy_hz == POLICY_HZ
