"""The folder that a run leaves: summary.json, run.csv and the foot-contact picture."""

import csv
import json
import time
from itertools import count
from pathlib import Path

import msgspec

from rmll_common.errors import InputError
from rmll_gaits.label import FEET
from rmll_gaits.table import MachineTable
from rmll_hil.runs import outcome as outcomes
from rmll_hil.runs.metrics import SETTLING_NS, RunSummary
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.recording.telemetry import TelemetryRow
from rmll_onboard.state.modes import Mode

RUNS = Path("hil-runs")
SHOWN_NS = 4_000_000_000
TRUTH_COLUMNS = (
    *("true_x", "true_y", "true_z", "true_vx", "true_vy", "true_vz", "true_wz", "energy"),
    *(f"contact_{foot}" for foot in FEET),
    "grounded",
)


def folder(wanted: Path | None, gait: str) -> Path:
    """A new folder: ``wanted``, or hil-runs/GAIT-TIME. Raises InputError if it exists already."""
    if wanted is None:
        stem = RUNS / f"{gait}-{time.strftime('%Y%m%d-%H%M%S')}"
        names = (stem if n == 1 else stem.with_name(f"{stem.name}-{n}") for n in count(1))
        wanted = next(name for name in names if not name.exists())
    try:
        wanted.mkdir(parents=True)
    except FileExistsError as error:
        raise InputError(f"{wanted} exists already; a run needs a new folder") from error
    return wanted


def write(
    path: Path, outcome: Outcome, summary: RunSummary, table: MachineTable, title: str
) -> None:
    """Fill the folder; the picture is left out if the robot did not walk long enough."""
    (path / "summary.json").write_text(json.dumps(msgspec.to_builtins(summary), indent=2) + "\n")
    _write_csv(path / "run.csv", outcome)
    start = outcome.report.walking_start_ns or 0
    steady = [row for row in outcome.log if _is_shown(row, start)]
    if steady:
        # matplotlib takes half a second to load, which an emulator's own process need not spend
        from rmll_view.contact_diagram import contact_figure

        contact_figure(
            path / "contact.png",
            (outcomes.times(steady) - start) / 1e9,
            outcomes.column(steady, *(f"down_{foot}" for foot in FEET)).astype(bool),
            outcomes.states(steady, table),
            table,
            outcomes.column(steady, "off_spec").astype(bool),
            title,
            window=2.0,
        )


def _is_shown(row: TelemetryRow, start: int) -> bool:
    """The first seconds of steady walking."""
    return row.mode == Mode.WALKING and 0 <= row.t_ns - start - SETTLING_NS < SHOWN_NS


def _write_csv(path: Path, outcome: Outcome) -> None:
    """The daemon's log, the newest truth of each row's time beside it, and time in seconds."""
    if not outcome.log:
        return
    stamps = outcomes.times(outcome.log)
    truth = outcome.truth[outcomes.at(outcome.truth["time_ns"], stamps)]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", *outcome.log[0].__struct_fields__, *TRUTH_COLUMNS])
        for stamp, row, sample in zip(stamps, outcome.log, truth, strict=True):
            _, position, velocity, yaw_rate, energy, contact, grounded = sample.tolist()
            motion = [f"{value:.6g}" for value in (*position, *velocity, yaw_rate, energy)]
            flags = [int(flag) for flag in (*contact, grounded)]
            seconds = f"{(stamp - stamps[0]) / 1e9:.4f}"
            writer.writerow([seconds, *msgspec.structs.astuple(row), *motion, *flags])
