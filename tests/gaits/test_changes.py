"""What differs between two versions of a gait is named."""

import pytest

from rmll_gaits.changes import changes
from rmll_gaits.compile import compile_gait
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.spec import read_spec

GAIT = """
gait: hop
commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}
cycle: [FL BR, {feet: FR BL, dwell: 1}]
"""


def versions(old: str, new: str) -> list[str]:
    before, after = (compile_gait(read_spec(text, "hop.yaml")) for text in (old, new))
    return list(changes(before, after))


@pytest.mark.parametrize("name", library_names())
def test_a_gait_has_not_changed_from_itself(name: str) -> None:
    assert list(changes(load_gait(name), load_gait(name))) == []


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("vx: [-1, 1]", "vx: [-0.5, 1]", "commands vx: [-1, 1], now [-0.5, 1]"),
        ("[6, 12]", "[6, 10]", "commands frequency: [6, 12], now [6, 10]"),
        ("dwell: 1", "dwell: 0.5", "rules of q1 for FR BL"),
        ("FL BR, {", "FL BR, none, {", "states: q0, q1, now q0, q1, q2"),
        ("cycle: [FL BR", "cycle: [FL FR", "rules of q0 for FL FR, FL BR"),
    ],
)
def test_each_change_is_named(old: str, new: str, told: str) -> None:
    assert told in versions(GAIT, GAIT.replace(old, new))


def test_a_comment_changes_nothing() -> None:
    assert versions(GAIT, "# the same\n" + GAIT) == []
