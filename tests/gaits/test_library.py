"""The library holds the paper's six gaits, written down here a second time, pose by pose."""

import numpy as np
import pytest

from rmll_common.errors import InputError
from rmll_gaits.label import hysteresis, label
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.machine import Machine, explained, step
from rmll_gaits.pose import to_label
from rmll_gaits.table import ADVANCE, REJECT

CYCLES = {
    "trot": [("FL BR", 1), ("FR BL", 1)],
    "pace": [("FL BL", 1), ("FR BR", 1)],
    "bound": [("FL FR", 1), ("BL BR", 1)],
    "walk": [("FR BL BR", 1), ("FL FR BL", 1), ("FL BL BR", 1), ("FL FR BR", 1)],
    "three_one": [("FL BL BR", 1), ("FL", 0.5), ("FR BL BR", 1), ("FR", 0.5)],
    "half_bound": [("FL FR", 1), ("BR", 1), ("FL FR", 1), ("BL", 1)],
}


def test_the_library_holds_the_six_gaits_and_two_of_ours():
    assert set(library_names()) == {*CYCLES, "pronk", "rotary_gallop"}


@pytest.mark.parametrize("gait", CYCLES)
def test_each_state_waits_for_one_pose_of_the_paper(gait):
    table, cycle = load_gait(gait), CYCLES[gait]
    assert table.gait == gait
    assert (table.start, table.num_states) == (0, len(cycle) + (gait == "half_bound"))
    for state, (pose, dwell) in enumerate(cycle):
        (opening,) = np.flatnonzero(table.effect[state] == ADVANCE)
        assert opening == to_label(pose)
        assert table.next_state[state, opening] == (state + 1) % len(cycle)
        assert table.dwell[state, opening] == dwell


@pytest.mark.parametrize("gait", CYCLES)
def test_command_ranges_are_the_paper_s(gait):
    commands = load_gait(gait).commands
    slow = gait == "walk"
    assert commands.vx == commands.wz == ((-0.5, 0.5) if slow else (-1, 1))
    assert commands.frequency == ((5, 10) if slow else (6, 12))


def test_only_half_bound_rejects_the_wrong_back_foot():
    table = load_gait("half_bound")
    assert table.states[table.sink] == "q_r"
    for state, foot, grace in ((0, "BR", 20), (1, "BL", 0), (2, "BL", 0), (3, "BR", 0)):
        rejecting = table.effect[state] == REJECT
        assert rejecting.tolist() == [bool(x & to_label(foot)) for x in range(16)]
        assert (table.grace[state][rejecting] == grace).all()
        assert (table.next_state[state][rejecting] == table.sink).all()
    others = [load_gait(gait) for gait in CYCLES if gait != "half_bound"]
    assert all(other.sink is None and (other.effect != REJECT).all() for other in others)


@pytest.mark.parametrize("gait", CYCLES)
@pytest.mark.parametrize("frequency", [5, 6, 9, 12])
def test_walking_the_poses_takes_every_edge_as_soon_as_it_may(gait, frequency):
    table = load_gait(gait)
    machine = Machine.of(table)
    state, phi, age = table.start, 0, 0
    for pose, dwell in CYCLES[gait] * 3:
        for wait in range(1, 100):
            at = step(machine, state, phi, to_label(pose), frequency, age)
            age += 1
            assert at.advanced == (wait >= dwell * frequency)
            state, phi = int(at.state), int(at.phi)
            if at.advanced:
                break
    assert state == table.start


def test_half_bound_may_stand_at_first_but_not_later():
    table = load_gait("half_bound")
    machine = Machine.of(table)
    assert not step(machine, 0, 0, 15, 6, age=19).rejected
    later = step(machine, 0, 0, 15, 6, age=20)
    assert later.rejected and later.state == table.sink
    for contact in range(16):
        assert step(machine, table.sink, 3, contact, 6, age=99).state == table.sink


def test_skimming_feet_do_not_break_a_trot():
    """Contacts in the form of the robot's signals: a foot low over the ground keeps its label."""
    machine = Machine.of(load_gait("trot"))
    down = np.ones(4, bool)
    lifted = np.array([True, False, False, True])  # FR and RL clear of the ground
    down = hysteresis(down, touching=~lifted, clear=lifted)
    assert label(down) == to_label("FL BR")
    assert explained(machine, 0, label(down))
    skimming = hysteresis(down, touching=~lifted, clear=np.zeros(4, bool))
    assert label(skimming) == to_label("FL BR")


def test_gaits_come_by_name_or_by_path(tmp_path):
    file = tmp_path / "mine.yaml"
    text = "gait: mine\ncommands: {vx: [0, 1], wz: [0, 0], frequency: [6, 6]}\ncycle: [none, FL]\n"
    file.write_text(text)
    assert load_gait(file).gait == load_gait(str(file)).gait == "mine"
    file.write_bytes(b"gait: \xff")
    for gait, message in (
        (
            "trott",
            "expected one of bound, half_bound, pace, pronk, rotary_gallop, three_one, trot,",
        ),
        (file, "not a text in UTF-8"),
        (tmp_path / "none.yaml", "cannot be read: No such file"),
        ("../library/trot", "expected one of"),
    ):
        with pytest.raises(InputError, match=message):
            load_gait(gait)
