"""Golden logs: short walks that today's daemon must replay to the byte, for ever.

One for each shipped policy, and one for each fault that the daemon reacts to. They are renewed on
purpose only, by ``make golden``, when a policy or the daemon's behaviour was meant to change.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from rmll_common import command_line
from rmll_common.errors import InputError
from rmll_hil.faults.fault_rows import BEGIN, ROWS, FaultRow
from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.fault_plan import parse_plan
from rmll_hil.runs import lockstep
from rmll_onboard.commands.operator import FlagOperator, Operator, OperatorCommand, RemoteOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.protocol.a1_remote import Remote
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.mcap_writer import log_file
from rmll_onboard.settings.runtime_settings import Motion, RuntimeSettings, Safety, Steering
from rmll_onboard.state.modes import NS, Mode

FOLDER = Path("tests/hil/golden")
FAULT_PREFIX = "fault-"
FAULTY_GAIT = "trot"
"""The policy that meets the faults"""
FAULTS = {
    **dict.fromkeys(("joint_past_limit", "joint_speed", "power"), 0.2),
    **dict.fromkeys(("silent_board", "frozen_values", "nan_joint", "wild_action"), 0.2),
    **dict.fromkeys(("braked_joint", "emergency_stop", "bad_network"), 0.2),
    **dict.fromkeys(("other_commander", "hot_motor"), 0.8),
    **dict.fromkeys(("corruption", "pushed_over", "remote_lost"), 0.7),
}
"""Of the fault table, and how long each is watched [s]"""
EARLIER = 1.0
"""[s] that a fault comes earlier here than in the table; the robot has just begun to walk"""
# A robot stands up in half a second, which keeps the logs short
_MOTION = Motion(crouch=0.1, rise=0.3, settle=0.1, slow_down=0.2, sit=0.2)


@dataclass(frozen=True)
class Story:
    """What happens in a golden log."""

    name: str
    operator: Operator
    settings: RuntimeSettings
    plan: tuple[dict[str, Any], ...] = ()


class _Until:
    """An operator whose time is limited."""

    def __init__(self, operator: Operator, seconds: float) -> None:
        self._operator = operator
        self._end = int(seconds * NS)
        self._now = 0
        self.by_remote = operator.by_remote
        self.complaint = None

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        self._now = now
        return self._operator.orders(now, mode, remote)

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return self._now >= self._end


def walk(bundle: Bundle) -> Story:
    """Forward and turning, slow steps and then fast ones, from lying to lying."""
    commands = bundle.table.commands
    low, high = commands.frequency
    operator = FlagOperator(
        commands, 0.4 * commands.vx[1], 0.2 * commands.wz[1], (high, low), seconds=1.0
    )
    return Story(bundle.contract.gait, operator, RuntimeSettings(motion=_MOTION))


def fault(row: FaultRow, bundle: Bundle) -> Story:
    """The fault as in the table, a little earlier."""
    commands = bundle.table.commands
    operator = (
        RemoteOperator(commands, commands.middle_frequency, Steering().deadband)
        if row.remote
        else FlagOperator(commands, vx=0.4)
    )
    return Story(
        FAULT_PREFIX + row.name,
        _Until(operator, BEGIN - EARLIER + FAULTS[row.name]),
        RuntimeSettings(motion=_MOTION, safety=msgspec.convert(row.settings, Safety)),
        tuple(
            entry | {"at": entry["at"] - (EARLIER if entry["at"] == BEGIN else 0.0)}
            for entry in row.plan
        ),
    )


def record(story: Story, bundle: Bundle, path: Path) -> str | None:
    """Play a story into a new log; returns the fault that ended it, if one did."""
    about = describe(bundle, story.settings, real_time=False)
    about = msgspec.structs.replace(about, arguments=[])  # ours say nothing about the walk
    plan = parse_plan(story.plan, bundle.robot)
    emulator = Emulator(robot=bundle.robot, plan=plan)
    with log_file(path, about, compact=True) as log:
        outcome = lockstep.walk(
            emulator, bundle, story.operator, lambda _: None, log.add, story.settings
        )
    return outcome.report.fault


def stories(policies: Path) -> Iterator[tuple[Story, Bundle]]:
    """All golden logs that there should be."""
    paths = sorted(policies.glob("*.onnx"))
    bundles = {bundle.contract.gait: bundle for bundle in map(load_bundle, paths)}
    for bundle in bundles.values():
        yield walk(bundle), bundle
    if FAULTY_GAIT not in bundles:
        raise InputError(f"{policies}: no {FAULTY_GAIT}.onnx, which is to meet the faults")
    rows = {row.name: row for row in ROWS}
    for name in FAULTS:
        yield fault(rows[name], bundles[FAULTY_GAIT]), bundles[FAULTY_GAIT]


def golden(policies: Path = Path("policies"), out: Path = FOLDER) -> None:
    """Renew the golden logs: look at what changed before you commit them.

    Args:
        policies: The shipped bundles.
        out: Folder of the logs; all that are there are replaced.
    """
    with tempfile.TemporaryDirectory(prefix="golden-", dir=out.parent) as scratch:
        made = Path(scratch)
        for story, bundle in stories(policies):
            path = made / f"{story.name}.mcap"
            found = record(story, bundle, path)
            print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB, {found or 'no fault'}")
        out.mkdir(exist_ok=True)
        for old in out.glob("*.mcap"):
            old.unlink()
        for path in made.iterdir():
            path.replace(out / path.name)
    print(f"{sum(path.stat().st_size for path in out.glob('*.mcap')) / 1e6:.2f} MB in {out}")


def main() -> None:
    command_line.run("golden", golden)


if __name__ == "__main__":
    main()
