"""``rmll-hil faults``: provoke every fault of the table, and see what the daemon does."""

import multiprocessing
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rmll_hil.faults import broken_policy, fault_realtime, fault_virtual
from rmll_hil.faults.fault_rows import FaultRow, Reaction
from rmll_hil.faults.fault_trial import FaultTrial
from rmll_onboard.safety.faults import Fault
from rmll_robots import A1, Robot

TEST = "tests/hil/test_fault_table.py"
PAGE = """# Faults, and what the daemon does about them

Each row was provoked in the emulator, through the real daemon and its loop, {clock}, when
the robot had walked at 0.4 m/s for a second{repeated}. Milliseconds are from the fault to the
first command of the reaction as it reached the robot. To sit down, the robot first walks on the
spot (here for 0.3 s). The test of a row is `{test}::test_fault[NAME]`.

Made with `rmll-hil faults --policy {policy}{flags} --out docs/faults.md`.

| fault | ms | reaction | as it should | the daemon's words | name |
|---|---|---|---|---|---|
{rows}

## By cause and mode

Every fault that the daemon knows, `onboard/rmll_onboard/safety/faults.py`, and what it makes of a
robot that lies damped, that stands or is on its way up or down, and that walks. What damps does so
for as long as the program lives.

| fault | is | lies damped | stands | walks |
|---|---|---|---|---|
{faults}
"""


@dataclass(frozen=True)
class FaultResult:
    """What came of a row."""

    row: FaultRow
    reaction: Reaction
    milliseconds: int | None
    """From the fault to the first command of the reaction, as it reaches the robot"""
    told: str
    """The daemon's fault or its warnings"""

    @property
    def as_expected(self) -> bool:
        return self.reaction == self.row.reaction and self.row.words in self.told


def provoke(
    rows: Iterable[FaultRow],
    policy: Path,
    jobs: int = 1,
    robot: Robot = A1,
    realtime: bool = False,
    times: int = 1,
) -> Iterator[list[FaultResult]]:
    """Run each row ``times`` times, ``jobs`` at a time; a list of results each, in their order.

    From one time to the next the noise of the sensors differs. ``realtime`` is over UDP, with the
    daemon in a process of its own; otherwise time is virtual.
    """
    trials = [(row, seed) for row in rows for seed in range(times)]
    once = partial(provoke_once, policy=policy, robot=robot, realtime=realtime)
    # a process each: they would wait for one another's interpreter, and signals need a main thread
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        results = pool.map(once, *zip(*trials, strict=True))
        for _ in range(len(trials) // times):
            yield [next(results) for _ in range(times)]


def provoke_once(
    row: FaultRow, seed: int, policy: Path, robot: Robot, realtime: bool
) -> FaultResult:
    """One row, with a robot and a daemon of its own."""
    with tempfile.TemporaryDirectory() as folder:
        if row.answer is not None:
            broken = Path(folder, "broken.onnx")
            broken_policy.write(broken, policy, row.answer)
            policy = broken
        run = fault_realtime.run if realtime else fault_virtual.run
        return FaultResult(row, *run(row, FaultTrial(row, robot, seed), policy))


def markdown(results: Sequence[Sequence[FaultResult]], policy: Path, realtime: bool) -> str:
    """The table as a page of the documentation."""
    times = len(results[0])
    lines = [
        f"| {row.what} | {span(many)} | {many[0].reaction} | {score(many)} "
        f"| {told(many) or '-'} | `{row.name}` |"
        for many in results
        for row in [many[0].row]
    ]
    return PAGE.format(
        policy=policy,
        test=TEST,
        rows="\n".join(lines),
        clock="in real time and over UDP" if realtime else "in virtual time",
        repeated=f", {times} times with other noise of the sensors" if times > 1 else "",
        faults="\n".join(map(_by_mode, Fault)),
        flags=" --realtime" * realtime + f" --times {times}" * (times > 1),
    )


def _by_mode(fault: Fault) -> str:
    lying, standing, walking = "damps when it shall stand up", "damps", "damps"
    if fault.of_any_robot:
        lying = "damps"
    if fault.of_walks_only:
        lying = standing = "-"
    if fault is Fault.DEADLINES_MISSED:
        lying = "-"
    if fault is Fault.SENSORS_DISAGREE:
        lying = f"does not stand up: `{Fault.NOT_READY}`"
    if fault is Fault.NOT_READY:
        standing = walking = "-"
    return f"| `{fault}` | {fault.meaning} | {lying} | {standing} | {walking} |"


def score(many: Sequence[FaultResult]) -> str:
    """How many of the times were as expected: 5/5."""
    return f"{sum(result.as_expected for result in many)}/{len(many)}"


def span(many: Sequence[FaultResult]) -> str:
    """Of the milliseconds, the least and the most."""
    found = sorted({r.milliseconds for r in many if r.milliseconds is not None})
    return "-" if not found else "-".join(map(str, dict.fromkeys((found[0], found[-1]))))


def told(many: Sequence[FaultResult]) -> str:
    """The daemon's words: the first that were not as expected, else the first."""
    return next((result for result in many if not result.as_expected), many[0]).told
