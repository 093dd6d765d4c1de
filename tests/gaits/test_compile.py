import numpy as np

from rmll_gaits.compile import compile_gait
from rmll_gaits.pose import to_label
from rmll_gaits.spec import read_spec
from rmll_gaits.table import ADVANCE, REJECT, STAY

GAIT = """
gait: hop
commands: {vx: [-1, 1], wz: [-0.5, 0.5], frequency: [6, 12]}
start: q1
states:
  q0:
    edges:
      - {when: FL & FR, to: q1, dwell: 0.5}
      - {when: "BL & !(FL & FR)", reject: true, grace: 7}
    hold: BR
  q1:
    - {when: BL & BR, to: q0}
"""
TABLE = compile_gait(read_spec(GAIT, "hop.yaml"))
LABELS = range(16)


def test_states_and_ranges_come_from_the_file_and_the_sink_is_last():
    assert TABLE.states == ("q0", "q1", "q_r")
    assert (TABLE.start, TABLE.sink) == (1, 2)
    assert TABLE.commands.wz == (-0.5, 0.5)


def test_each_label_does_what_its_guard_says():
    front, back_left = to_label("FL FR"), to_label("BL")
    for label in LABELS:
        if label & front == front:
            expected = (1, ADVANCE, 0.5, 0)
        elif label & back_left:
            expected = (2, REJECT, 0.0, 7)
        else:
            expected = (0, STAY, 0.0, 0)
        cell = (0, label)
        found = TABLE.next_state[cell], TABLE.effect[cell], TABLE.dwell[cell], TABLE.grace[cell]
        assert found == expected


def test_the_sink_keeps_every_label_and_explains_none():
    assert (TABLE.effect[2] == STAY).all()
    assert (TABLE.next_state[2] == 2).all()
    assert not TABLE.hold[2].any()


def test_a_hold_is_as_written_or_what_leads_in_and_the_start_may_stand():
    br, front = to_label("BR"), to_label("FL FR")
    assert np.flatnonzero(TABLE.hold[0]).tolist() == [x for x in LABELS if x & br]
    assert np.flatnonzero(TABLE.hold[1]).tolist() == [x for x in LABELS if x & front == front]


def test_the_start_state_may_stand_on_all_feet():
    table = compile_gait(read_spec(GAIT.replace("FL & FR,", '"FL & FR & !BL & !BR",'), "hop.yaml"))
    assert np.flatnonzero(table.hold[1]).tolist() == [to_label("FL FR"), 15]
