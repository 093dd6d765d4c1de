"""``rmll-hil feet``: the table of foot sensors on the screen and in a file."""

import dataclasses
import json
from pathlib import Path

from rich.progress import MofNCompleteColumn
from rich.table import Table

from rmll_common.errors import Failure, InputError
from rmll_common.flag import within
from rmll_common.output_file import output_file
from rmll_hil.runs.feet_table import CASES, Case, FeetResult, entry, markdown, walk_all
from rmll_onboard.control.shipped_policies import find_policy
from rmll_view.console import bar, console


def feet(
    policies: tuple[Path, ...],
    only: tuple[str, ...],
    seconds: float,
    jobs: int,
    out: Path | None,
    print_json: bool,
) -> None:
    """Arguments as the command's. Raises Failure, after all is printed, for a walk that was worse
    than one that is told the unit."""
    within("jobs", jobs, 1, 16)
    within("seconds", seconds, 2, 600)
    out = out and output_file("--out", out, "feet.md")
    cases, bundles = _chosen(only), [find_policy(policy) for policy in policies]
    with bar(MofNCompleteColumn()) as progress:
        found = walk_all(cases, bundles, seconds, jobs)
        total = len(cases) * len(bundles)
        results = list(progress.track(found, total=total, description="foot sensors"))
    if out:
        out.write_text(markdown(results))
    if print_json:
        entries = [dataclasses.asdict(r) | {"as_expected": r.as_expected} for r in results]
        print(json.dumps(entries))
    else:
        _show(results)
    if wrong := [f"{r.case} ({r.gait})" for r in results if not r.as_expected]:
        raise Failure(f"not as expected: {', '.join(wrong)}")


def _chosen(only: tuple[str, ...]) -> list[Case]:
    names = [case.name for case in CASES]
    for name in only:
        if name not in names:
            raise InputError(f"--only {name!r}: unknown; known: {'; '.join(names)}")
    return [case for case in CASES if not only or case.name in only]


def _show(results: list[FeetResult]) -> None:
    gaits = list(dict.fromkeys(result.gait for result in results))
    table = Table("foot sensors", *gaits, "named", box=None)
    for case in dict.fromkeys(result.case for result in results):
        row = [result for result in results if result.case == case]
        style = None if all(result.as_expected for result in row) else "red"
        named = sum(len(result.doubts) for result in row)
        table.add_row(case, *map(entry, row), str(named or "-"), style=style)
    console().print(table)
