"""c_f up and down while walking, as the paper did on hardware."""

from pathlib import Path

import pytest

from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.runs import lockstep, sweep
from rmll_hil.runs.outcome import column
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.settings import runtime_settings as onboard
from rmll_onboard.settings.runtime_settings import Safety, Steering

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


def test_the_trot_follows_c_f_from_12_to_6_and_back(tmp_path: Path) -> None:
    bundle = load_bundle(TROT)
    values, seconds = (12.0, 6.0, 12.0), 12.0
    operator = FlagOperator(bundle.table.commands, 0.5, 0.0, values, seconds)
    outcome = lockstep.walk(Emulator(EmulatorSettings(seed=2)), bundle, operator, lambda _: None)
    assert outcome.report.fault is None
    found = sweep.phases(outcome, bundle.table, values, seconds)
    assert [phase.frequency for phase in found] == list(values)
    assert all(phase.adherence > 0.9 for phase in found)
    slow, fast, again = (phase.transitions for phase in found)
    assert fast > 1.4 * max(slow, again)
    told = column([row for row in outcome.log if row.mode == "walking"], "frequency")
    assert (told.min(), told.max()) == (6, 12)
    steps = abs(told[1:] - told[:-1])
    assert 0 < steps.max() <= Steering().frequency / 50 + 1e-9
    sweep.draw(tmp_path / "frequency.png", outcome, found, "trot")
    assert (tmp_path / "frequency.png").stat().st_size > 10_000


def test_a_walk_that_ends_early_has_figures_of_what_it_reached(standing: Path) -> None:
    bundle = load_bundle(standing)
    emulator = Emulator()

    def kick(seconds: float) -> None:
        if seconds > 5:
            emulator.world.data.qvel[3] = 8.0  # roll

    values = (12.0, 6.0, 12.0)
    operator = FlagOperator(bundle.table.commands, frequency=values, seconds=3.0)
    # a policy that stands makes no transitions
    patient = onboard.RuntimeSettings(safety=Safety(stuck=100))
    outcome = lockstep.walk(emulator, bundle, operator, kick, settings=patient)
    assert outcome.report.fault
    found = sweep.phases(outcome, bundle.table, values, 3.0)
    assert [phase.frequency for phase in found] == [12.0, 6.0]
    assert found[0].seconds == pytest.approx(1.0)
    assert found[1].seconds < 0.7
