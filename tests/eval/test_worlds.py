"""The shipped trot in both worlds."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnxruntime import InferenceSession
from tensordict import TensorDict

from rmll_common.errors import InputError
from rmll_eval import emulated, trained
from rmll_eval.conditions import PUSH_INTERVAL, Conditions, pushes
from rmll_eval.evaluation_case import EvaluationCase
from rmll_export.checkpoint_reader import read
from rmll_export.graph import build
from rmll_onboard.control.bundle import load_bundle

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
FLAT = Conditions()
TRIALS = [EvaluationCase(0.5, 0.0, 8.0, seed) for seed in (0, 1)]


def test_the_number_of_jobs_changes_nothing() -> None:
    alone = list(emulated.walks(TROT, TRIALS, 1.5, FLAT, jobs=1))
    together = list(emulated.walks(TROT, TRIALS, 1.5, FLAT, jobs=2))
    assert alone == together
    assert [walk.trial for walk in alone] == TRIALS
    first, second = alone
    assert first.energy_per_metre != second.energy_per_metre
    assert first.falls == 0 and first.distance > 0.3


def test_the_trainers_world_walks_each_trial_with_its_own_command() -> None:
    trials = [
        EvaluationCase(0.8, 0.0, 8.0, 0),
        EvaluationCase(-0.8, 0.0, 12.0, 1),
        EvaluationCase(0.0, 0.0, 8.0, 2),
    ]
    forth, back, still = trained.walks(TROT, trials, 2.0, FLAT)
    assert [w.trial for w in (forth, back, still)] == trials
    assert min(forth.distance, back.distance) > 1.0 > still.distance
    for walk in (forth, back, still):
        assert walk.adherence and 0.8 < walk.adherence <= 1.1
        assert walk.vx_error is not None and walk.vx_error < 0.4
        assert walk.falls == 0


def test_ground_and_pushes_disturb_the_walks_of_both_worlds(monkeypatch) -> None:
    monkeypatch.setattr("rmll_eval.conditions.PUSH_INTERVAL", 0.5)
    monkeypatch.setattr("rmll_eval.trained.PUSH_INTERVAL", 0.5)
    pushed, rough = Conditions(pushes=True), Conditions("rough", 2)
    emulator = {c: emulated.walk(TROT, 1.5, c, TRIALS[0]) for c in (FLAT, pushed, rough)}
    trainer = {c: next(trained.walks(TROT, TRIALS[:1], 1.5, c)) for c in (FLAT, pushed, rough)}
    for world in (emulator, trainer):
        assert len({walk.energy_per_metre for walk in world.values()}) == 3
        calm, disturbed, _ = (walk.vx_error for walk in world.values())
        assert calm and disturbed and disturbed > calm


def test_pushes_come_while_the_robot_walks_and_follow_the_seed() -> None:
    planned = pushes(seed=1, seconds=20.0)
    assert [push.at for push in planned] == [5, 10, 15]
    assert pushes(1, PUSH_INTERVAL) == []
    assert pushes(1, 20.0) == planned != pushes(2, 20.0)
    drawn = np.array([push.velocity for seed in range(300) for push in pushes(seed, 20.0)])
    assert np.abs(drawn).max() == pytest.approx(1.0, abs=0.01) and np.abs(drawn).max() <= 1
    assert np.abs(drawn.mean(0)).max() < 0.1


@pytest.mark.parametrize("activation", ["Relu", "Elu"])
def test_the_policy_in_torch_answers_as_the_graph_does(activation: str, tmp_path: Path) -> None:
    model = build(read(TROT.with_suffix(".safetensors")))
    for node in model.graph.node:
        node.op_type = activation if node.op_type == "Relu" else node.op_type
    bundle = tmp_path / "policy.onnx"
    onnx.save(model, bundle)
    session = InferenceSession(bundle)
    observed = np.array(load_bundle(TROT).contract.trace.observation, np.float32)
    runs = [session.run(["action"], {"observation": row[None]}) for row in observed]
    theirs = np.concatenate([np.asarray(action) for (action,) in runs])
    with torch.no_grad():
        ours = trained.actor(bundle)(
            TensorDict({"policy": torch.from_numpy(observed)}, [len(observed)])
        )
    np.testing.assert_allclose(ours, theirs, atol=1e-4)
    assert ours.std() > 0.01


def test_an_activation_that_is_not_known_is_refused(tmp_path: Path) -> None:
    model = build(read(TROT.with_suffix(".safetensors")))
    next(node for node in model.graph.node if node.op_type == "Relu").op_type = "Tanh"
    onnx.save(model, tmp_path / "policy.onnx")
    with pytest.raises(InputError, match="the policy's graph has Tanh nodes, expected Relu or Elu"):
        trained.actor(tmp_path / "policy.onnx")


def test_the_policy_in_torch_answers_as_it_did_in_training() -> None:
    trace = load_bundle(TROT).contract.trace
    observed = TensorDict({"policy": torch.tensor(trace.observation)}, [len(trace.observation)])
    with torch.no_grad():
        answers = trained.actor(TROT)(observed).numpy()
    assert np.abs(answers - np.array(trace.action)).max() == pytest.approx(0, abs=1e-4)
