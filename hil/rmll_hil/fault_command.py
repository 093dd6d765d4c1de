"""``rmll-hil faults``: the fault table on the screen and in a file."""

import json
from pathlib import Path

from rich.progress import MofNCompleteColumn
from rich.table import Table

from rmll_contract.flag import within
from rmll_contract.output import output_file
from rmll_gaits.errors import Failure, InputError
from rmll_hil.fault_rows import ROWS, Row
from rmll_hil.fault_table import Result, markdown, provoke
from rmll_onboard.bundle import load_bundle
from rmll_onboard.controller import prove
from rmll_onboard.shipped import find_policy
from rmll_view.console import bar, console


def faults(
    policy: Path, only: tuple[str, ...], jobs: int, out: Path | None, print_json: bool
) -> None:
    """Arguments as the command's. Raises Failure, after all is printed, for a wrong reaction."""
    rows = _chosen(only)
    out = out and output_file("--out", out, "faults.md")
    within("jobs", jobs, 1, 16)
    policy = find_policy(policy)
    bundle = load_bundle(policy)
    prove(bundle)
    with bar(MofNCompleteColumn()) as progress:
        found = provoke(rows, policy, jobs, bundle.robot)
        results = list(progress.track(found, total=len(rows), description="faults"))
    if out:
        out.write_text(markdown(results, policy))
    if print_json:
        print(json.dumps({result.row.name: _entries(result) for result in results}))
    else:
        _show(results)
    if wrong := [result.row.name for result in results if not result.as_expected]:
        raise Failure(f"not as expected: {', '.join(wrong)}")


def _chosen(only: tuple[str, ...]) -> list[Row]:
    names = [row.name for row in ROWS]
    for name in only:
        if name not in names:
            raise InputError(f"--only {name}: unknown fault; known: {', '.join(names)}")
    return [row for row in ROWS if not only or row.name in only]


def _entries(result: Result) -> dict[str, object]:
    return {
        "milliseconds": result.milliseconds,
        "reaction": result.reaction,
        "told": result.told,
        "as_expected": result.as_expected,
    }


def _show(results: list[Result]) -> None:
    table = Table("fault", "ms", "reaction", "the daemon's words", box=None)
    for result in results:
        style = None if result.as_expected else "red"
        milliseconds = "-" if result.milliseconds is None else str(result.milliseconds)
        table.add_row(
            result.row.name, milliseconds, result.reaction, result.told or "-", style=style
        )
    console().print(table)
