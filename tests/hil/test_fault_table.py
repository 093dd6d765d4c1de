"""The fault table over UDP: the daemon a process of its own, the robot in real time.

In lockstep, without the machine's own lateness: ``test_protections.py``.
"""

import dataclasses
from pathlib import Path

import pytest

from rmll_gaits.errors import InputError
from rmll_hil import fault_command
from rmll_hil.fault_rows import ROWS, Reaction
from rmll_hil.fault_table import Result, markdown, provoke

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
JOBS = 2
"""More at a time get in each other's way on two processors"""


@pytest.fixture(scope="module")
def results() -> dict[str, Result]:
    """All rows, some at a time: most of a row is waiting for a robot to stand up."""
    return {result.row.name: result for result in provoke(ROWS, TROT, JOBS)}


@pytest.mark.slow
@pytest.mark.parametrize("name", [row.name for row in ROWS])
def test_fault(name: str, results: dict[str, Result]) -> None:
    result = results[name]
    assert result.reaction == result.row.reaction, result.told
    assert result.row.words in result.told
    assert (result.milliseconds is None) == (result.reaction == Reaction.WALKS)


def test_another_reaction_or_other_words_are_not_as_expected() -> None:
    row = next(row for row in ROWS if row.name == "flipped_imu")
    fine = Result(row, Reaction.DAMPS, 4, "tilted: roll 3.10 rad, pitch 0.00 rad")
    assert fine.as_expected
    assert not dataclasses.replace(fine, reaction=Reaction.WALKS).as_expected
    assert not dataclasses.replace(fine, told="no state from the robot").as_expected
    page = markdown([fine], TROT)
    assert "| 4 | damps | tilted: roll 3.10 rad, pitch 0.00 rad | `flipped_imu` |" in page


@pytest.mark.parametrize(
    ("only", "jobs", "words"),
    [
        (("earthquake",), 1, "--only earthquake: unknown fault; known: pushed_over, "),
        ((), 0, "--jobs 0: expected 1 to 16"),
    ],
)
def test_wrong_flags_are_refused(only: tuple[str, ...], jobs: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        fault_command.faults(TROT, only, jobs, None, False)
