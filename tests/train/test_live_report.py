"""What a run shows while it trains fits into a terminal of 80 columns."""

import io
from dataclasses import replace

from rich.console import Console

from rmll_gaits.load import load_gait
from rmll_train.learning.precision import Precision
from rmll_train.live_report import LiveReport
from rmll_train.training import Judging, Start, TrainingProgress

METRICS = {"adherence": 0.97, "vx_error": 1.234, "wz_error": 0.31, "energy_per_metre": 12345.0}


START = Start(Precision(True, 2.0), load_gait("trot").commands, 0, 12_000_000)


def shown(*told: Start | TrainingProgress | Judging) -> list[str]:
    screen = io.StringIO()
    console = Console(file=screen, width=80, force_terminal=True, color_system=None, markup=False)
    with LiveReport(console) as report:
        for progress in (START, *told):
            report(progress)
    return screen.getvalue().replace("\r", "\n").splitlines()


def test_time_left_bar_and_figures_show_in_80_columns() -> None:
    lines = shown(TrainingProgress(11_980_000, 12_000_000, 123_456.0, METRICS, {}))
    whole = "\n".join(lines)
    assert "matrix products in bfloat16: bfloat16 takes 0.50 of" in whole
    assert any("11.98 M steps, 123,456/s" in line and "left" in line for line in lines)
    assert any(line.strip("\x1b[2K").endswith("12345 J/m") and "vx 247%" in line for line in lines)
    assert "…" not in whole


def test_the_judgement_has_its_own_bar() -> None:
    lines = shown(TrainingProgress(1000, 1000, 1.0, METRICS, {}), Judging(275, 550))
    assert any("judging without exploration" in line and "50%" in line for line in lines)


def test_a_run_that_has_taken_its_steps_says_so() -> None:
    done = replace(START, steps=3_004_416, total=3_000_000)
    assert not any("nothing left" in line for line in shown())
    assert "nothing left to train: the run has 3,004,416 of 3,000,000 steps" in "\n".join(
        shown(done)
    )
