"""Today's daemon sends what it sent when the golden logs were made; see rmll_hil.golden."""

from pathlib import Path

import pytest

from rmll_hil.faults.fault_rows import ROWS, Reaction
from rmll_hil.golden import FAULT_PREFIX, FAULTS, FOLDER
from rmll_hil.replay.replay import find_bundle, replay
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.recording.log_metadata import versions

ROOT = Path(__file__).parents[2]
POLICIES = ROOT / "policies"
LOGS = sorted((ROOT / FOLDER).glob("*.mcap"))
ROUNDING = 1e-4
"""[rad] that another processor's matrix kernels may move a joint target"""


@pytest.mark.parametrize("path", LOGS, ids=lambda path: path.stem)
def test_the_daemon_sends_what_it_sent(path: Path) -> None:
    log = FlightLog(path)
    bundle = load_bundle(find_bundle(log, POLICIES))
    assert log.about.digest == bundle.contract.digest, "the policy is another: make golden"
    found = replay(log, bundle, lambda _: None)
    assert found.missing is None and found.complete
    assert found.ticks > 100
    if log.about.versions == versions():
        assert found.identical, found.first
    else:
        assert found.largest <= ROUNDING, (found.first, found.remarks)


@pytest.mark.parametrize(
    "row", [row for row in ROWS if row.name in FAULTS], ids=lambda row: row.name
)
def test_a_fault_is_in_its_log(row) -> None:
    """So that nothing was recorded but a robot that stood."""
    *_, last = FlightLog(ROOT / FOLDER / f"{FAULT_PREFIX}{row.name}.mcap").ticks()
    damped = not A1BoardPackets().decode_command(last.answer).kp.any()
    assert damped == (row.reaction is Reaction.DAMPS)


def test_every_shipped_policy_and_every_fault_has_a_log() -> None:
    policies = {path.stem for path in POLICIES.glob("*.onnx")}
    assert {path.stem for path in LOGS} == policies | {FAULT_PREFIX + name for name in FAULTS}


def test_the_logs_stay_small() -> None:
    assert sum(path.stat().st_size for path in LOGS) < 2.5e6
