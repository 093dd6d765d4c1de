import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_gaits.load import load_gait
from rmll_gaits.table import MachineTable

ARRAYS = ("next_state", "effect", "dwell", "grace", "hold")


@given(st.integers(0, 2**32 - 1))
def test_json_keeps_a_table_exactly(random_table, seed):
    table = random_table(seed)
    twin = MachineTable.from_dict(json.loads(json.dumps(table.to_dict())))
    assert twin.to_dict() == table.to_dict()
    for name in ARRAYS:
        array, other = getattr(table, name), getattr(twin, name)
        assert array.dtype == other.dtype
        assert np.array_equal(array, other)
    assert (twin.states, twin.sink, twin.commands) == (table.states, table.sink, table.commands)


def test_tables_cannot_be_changed():
    table = load_gait("trot")
    for name in ARRAYS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(table, name)[0, 0] = 1


@pytest.mark.parametrize(
    ("entry", "value", "message"),
    [
        ("next_state", [[7] * 16, [0] * 16], "next_state outside 0..1"),
        ("effect", [[3] * 16, [0] * 16], "effect is not"),
        ("dwell", [[-1.0] * 16] * 2, "dwell and grace"),
        ("dwell", [[float("nan")] * 16] * 2, "dwell and grace"),
        ("grace", [[0] * 15] * 2, r"grace has shape \(2, 15\), expected \(2, 16\)"),
        ("start", 2, "start or sink outside 0..1"),
        ("sink", -1, "start or sink outside 0..1"),
        ("start", 0.5, "cannot be read"),
        ("sink", 0.5, "cannot be read"),
        ("states", [], "expected"),
        ("commands", {}, "cannot be read"),
        ("hold", None, "hold has object, expected bool"),
        ("hold", [[2] * 16] * 2, "hold has int64, expected bool"),
        ("next_state", [[0.5] * 16] * 2, "next_state has float64, expected int64"),
        ("next_state", [[float("nan")] * 16] * 2, "next_state has float64, expected int64"),
        ("next_state", [[2**80] * 16] * 2, "next_state has object, expected int64"),
        ("dwell", [["1"] * 16] * 2, "dwell has <U1, expected float64"),
    ],
)
def test_an_edited_table_is_refused(entry, value, message):
    plain = load_gait("trot").to_dict() | {entry: value}
    with pytest.raises(InputError, match=message):
        MachineTable.from_dict(plain)


def test_a_table_with_a_missing_entry_is_refused():
    for entry in load_gait("trot").to_dict():
        plain = load_gait("trot").to_dict()
        del plain[entry]
        with pytest.raises(InputError):
            MachineTable.from_dict(plain)
