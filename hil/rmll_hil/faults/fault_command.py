"""``rmll-hil faults``: the fault table on the screen and in a file."""

import json
from pathlib import Path

from rich.progress import MofNCompleteColumn
from rich.table import Table

from rmll_common.errors import Failure, InputError
from rmll_common.flag import within
from rmll_common.output_file import output_file
from rmll_hil.faults.fault_rows import ROWS, FaultRow, Reaction
from rmll_hil.faults.fault_table import FaultResult, markdown, provoke, score, span, told
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import prove
from rmll_onboard.control.shipped_policies import find_policy
from rmll_view.console import bar, console


def faults(
    policy: Path,
    only: tuple[str, ...],
    realtime: bool,
    times: int,
    jobs: int,
    out: Path | None,
    print_json: bool,
) -> None:
    """Arguments as the command's.

    Raises Failure, after all is printed, for a wrong reaction, and for one that cannot be judged
    as the machine was too busy.
    """
    rows = _chosen(only)
    out = out and output_file("--out", out, "faults.md")
    within("jobs", jobs, 1, 16)
    within("times", times, 1, 1000)
    policy = find_policy(policy)
    bundle = load_bundle(policy)
    prove(bundle)
    with bar(MofNCompleteColumn()) as progress:
        found = provoke(rows, policy, jobs, bundle.robot, realtime, times)
        results = list(progress.track(found, total=len(rows), description="faults"))
    if out:
        out.write_text(markdown(results, policy, realtime))
    if print_json:
        print(json.dumps({many[0].row.name: list(map(_entries, many)) for many in results}))
    else:
        _show(results)
    _judge(results)


def _judge(results: list[list[FaultResult]]) -> None:
    wrong, not_judged = list[str](), list[str]()
    for many in results:
        bad = {result.reaction for result in many if not result.as_expected}
        if bad == {Reaction.NOT_JUDGED}:
            not_judged.append(many[0].row.name)
        elif bad:
            wrong.append(many[0].row.name)
    complaints = []
    if wrong:
        complaints.append(f"not as expected: {', '.join(wrong)}")
    if not_judged:
        complaints.append(f"not judged, as the machine was too busy: {', '.join(not_judged)}")
    if complaints:
        raise Failure("; ".join(complaints))


def _chosen(only: tuple[str, ...]) -> list[FaultRow]:
    names = [row.name for row in ROWS]
    for name in only:
        if name not in names:
            raise InputError(f"--only {name}: unknown fault; known: {', '.join(names)}")
    return [row for row in ROWS if not only or row.name in only]


def _entries(result: FaultResult) -> dict[str, object]:
    return {
        "milliseconds": result.milliseconds,
        "reaction": result.reaction,
        "told": result.told,
        "as_expected": result.as_expected,
    }


def _show(results: list[list[FaultResult]]) -> None:
    table = Table("fault", "ms", "reaction", "as it should", "the daemon's words", box=None)
    for many in results:
        style = None if all(result.as_expected for result in many) else "red"
        reaction = ", ".join(dict.fromkeys(result.reaction for result in many))
        table.add_row(
            many[0].row.name, span(many), reaction, score(many), told(many) or "-", style=style
        )
    console().print(table)
