from pathlib import Path

import numpy as np

from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.runs import lockstep
from rmll_hil.runs.metrics import summary
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.settings import runtime_settings as onboard
from rmll_onboard.settings.runtime_settings import Safety
from rmll_robots import A1

PATIENT = onboard.RuntimeSettings(safety=Safety(stuck=100))
"""A policy that stands makes no transitions"""


def stand(bundle: Path, seed: int = 0) -> Outcome:
    loaded = load_bundle(bundle)
    operator = FlagOperator(loaded.table.commands, seconds=1.0)
    emulator = Emulator(EmulatorSettings(seed=seed))
    return lockstep.walk(emulator, loaded, operator, lambda _: None, settings=PATIENT)


def test_stands_up_and_lies_down_again(standing: Path) -> None:
    outcome = stand(standing)
    # it walks as soon as it stands, so a log at 50 Hz need not see it stand
    modes = list(dict.fromkeys(row.mode for row in outcome.log))
    modes = [mode for mode in modes if mode != "standing"]
    assert modes == ["damping", "standing_up", "walking", "sitting_down"]
    assert outcome.report.fault is None
    height = outcome.truth["position"][:, 2]
    assert height.max() > 0.28
    assert height[-1] < 0.15
    # not while it plants its feet and sits down, which is faster than its weight
    before = outcome.truth["time_ns"] <= outcome.report.walking_end_ns
    upright = outcome.truth[before & (np.abs(height - height.max()) < 0.02)]
    assert upright["contact"].all(axis=1).mean() > 0.95


def test_every_datagram_arrives(standing: Path) -> None:
    packets = stand(standing).report.packets
    assert packets.rejected == packets.lost == 0
    # no state before the first command, and none for the farewell's
    assert packets.sent == packets.received + 1 + 100


def test_one_seed_one_outcome(standing: Path) -> None:
    first, again, other = (stand(standing, seed) for seed in (0, 0, 1))
    assert first.report == again.report
    assert first.log == again.log
    np.testing.assert_array_equal(first.truth, again.truth)
    assert (first.truth["position"] != other.truth["position"]).any()


def test_a_robot_that_is_knocked_over_has_fallen(standing: Path) -> None:
    emulator = Emulator()

    def kick(seconds: float) -> None:
        if seconds > 4.25:
            emulator.world.data.qvel[3] = 8.0  # roll

    loaded = load_bundle(standing)
    operator = FlagOperator(loaded.table.commands, seconds=10.0)
    outcome = lockstep.walk(emulator, loaded, operator, kick, settings=PATIENT)
    figures = summary(outcome, "trot", A1)
    assert figures.fault.startswith("tilted")
    assert figures.falls == 1
