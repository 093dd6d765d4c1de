"""The shipped trot in both worlds."""

from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from rmll_eval import emulated, trained
from rmll_eval.trial import Trial
from rmll_onboard.bundle import load_bundle

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
TRIALS = [Trial(0.5, 0.0, 8.0, seed) for seed in (0, 1)]


def test_the_number_of_jobs_changes_nothing() -> None:
    alone = list(emulated.walks(TROT, TRIALS, 1.5, jobs=1))
    together = list(emulated.walks(TROT, TRIALS, 1.5, jobs=2))
    assert alone == together
    assert [walk.trial for walk in alone] == TRIALS
    first, second = alone
    assert first.energy_per_metre != second.energy_per_metre
    assert first.falls == 0 and first.distance > 0.3


def test_the_trainers_world_walks_each_trial_with_its_own_command() -> None:
    trials = [Trial(0.8, 0.0, 8.0, 0), Trial(-0.8, 0.0, 12.0, 1), Trial(0.0, 0.0, 8.0, 2)]
    forth, back, still = trained.walks(TROT, trials, 2.0)
    assert [w.trial for w in (forth, back, still)] == trials
    assert min(forth.distance, back.distance) > 1.0 > still.distance
    for walk in (forth, back, still):
        assert walk.adherence and 0.8 < walk.adherence <= 1.1
        assert walk.vx_error is not None and walk.vx_error < 0.4
        assert walk.falls == 0


def test_the_policy_in_torch_answers_as_it_did_in_training() -> None:
    trace = load_bundle(TROT).contract.trace
    observed = TensorDict({"policy": torch.tensor(trace.observation)}, [len(trace.observation)])
    with torch.no_grad():
        answers = trained.actor(TROT)(observed).numpy()
    assert np.abs(answers - np.array(trace.action)).max() == pytest.approx(0, abs=1e-4)
