"""Recipes: stages that run one after the other, and those of the shipped policies."""

import signal
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml

from rmll_common.errors import InputError
from rmll_contract import contract, onnx_file
from rmll_export.checkpoint_reader import read
from rmll_train import cli
from rmll_train.checkpoint import load_checkpoint
from rmll_train.recipe import is_recipe, load_recipe, train_stages
from rmll_train.train_settings import TrainSettings
from rmll_train.training import TrainingProgress

ROOT = Path(__file__).parents[2]
BUNDLES = sorted((ROOT / "policies").glob("*.onnx"))
MACHINE = {"learner.bf16"}
"""Settings that depend on the processor and are in no recipe"""
TODAY: dict[str, str | None] = {
    "world.mistakes": "world.on_violation",
    "world.rewards.pressure": "world.rewards.cost_scale",
    "world.rewards.strict_above": "world.rewards.strict_above_adherence",
    "world.rewards.form": "world.rewards.reward_shaping",
    "world.rewards.bonus_on": "world.rewards.bonus_source",
}
"""What settings of the bundles are called today; None: no setting any more"""

SMALL = """
stages:
  - gait: half_bound
    world: {envs: 16}
    learner:
      {steps: 256, rollout: 8, epochs: 2, mini_batches: 2, hidden: [32, 32],
       estimator_hidden: [16], bf16: false}
  - world: {rewards: {velocity_yaw: 1.5}}
    learner: {steps: 512}
"""
"""Two stages of two updates"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


def command(monkeypatch: pytest.MonkeyPatch, *words: str | Path) -> None:
    monkeypatch.setattr(sys, "argv", ["rmll-train", *map(str, words)])
    cli.main()


def test_one_command_trains_all_stages_of_a_recipe(
    tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit, match="0"):
        command(monkeypatch, small, "--runs", tmp_path / "runs")
    (run,) = (tmp_path / "runs" / "half_bound").iterdir()
    assert yaml.safe_load((run / "result.yaml").read_text())["steps"] == 512
    origin = read(run / "policy.safetensors").contract.provenance
    assert [stage["steps"] for stage in origin["stages"]] == [256]
    assert_equal(load_recipe(small), origin)


def test_a_stopped_recipe_goes_on_in_the_stage_where_it_stopped(
    tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run, stages = tmp_path / "run", load_recipe(small)

    def stop(told: object) -> None:
        if isinstance(told, TrainingProgress) and told.steps == 384:
            signal.raise_signal(signal.SIGINT)

    assert not train_stages(run, stages, stop)
    assert load_checkpoint(run)["steps"] == 384
    with pytest.raises(SystemExit, match="0"):
        command(monkeypatch, small, "--resume", run)
    assert_equal(stages, read(run / "policy.safetensors").contract.provenance)
    with pytest.raises(SystemExit, match="2"):
        command(monkeypatch, small, "--resume", run, "--steps", "1k")
    assert "is a recipe: it takes --runs or --resume alone" in capsys.readouterr().err


def test_a_recipe_is_told_from_a_gait(tmp_path: Path, small: Path) -> None:
    assert is_recipe(str(small))
    (tmp_path / "hop.yaml").write_text("gait: hop\ncycle: [FL BR, FR BL]\n")
    for gait in ("trot", "missing.yaml", str(tmp_path / "hop.yaml")):
        assert not is_recipe(gait)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("velocity_yaw", "velocity_jaw", r"small.yaml:8:23: unknown key 'velocity_jaw'"),
        ("512", "256", r"small.yaml:8:5: learner.steps counts from the first stage"),
        ("  - world: {rew", "  - seed: 1\n    world: {rew", r"cannot change the gait or the seed"),
        ("envs: 16", "envs: 0", r"world.envs is 0, expected at least 1"),
        ("stages:", "stages: []\nmore:", r"unknown key 'more'"),
    ],
)
def test_a_wrong_recipe_is_refused_with_its_line(
    small: Path, old: str, new: str, complaint: str
) -> None:
    small.write_text(SMALL.replace(old, new))
    with pytest.raises(InputError, match=complaint):
        load_recipe(small)


@pytest.mark.parametrize("bundle", BUNDLES, ids=lambda path: path.stem)
def test_the_recipe_of_a_shipped_policy_is_what_its_bundle_records(bundle: Path) -> None:
    recipe = ROOT / "experiments" / f"{bundle.stem}.yaml"
    text = onnx_file.metadata(bundle.read_bytes())[contract.KEY]
    assert_equal(load_recipe(recipe), contract.decode(text, str(bundle)).provenance, recipe)


def assert_equal(
    stages: list[TrainSettings], origin: dict[str, Any], recipe: Path | None = None
) -> None:
    """Each stage's settings and steps are those of the record. What the record lacks, because the
    setting came later, ``recipe`` names, so that no later default gets into it."""
    recorded = [*origin["stages"], origin]
    assert len(stages) == len(recorded)
    for stage, record in zip(stages, recorded, strict=True):
        chosen, then = flat(msgspec.to_builtins(stage)), today(flat(record["settings"]))
        assert {name: chosen[name] for name in then} == then
        update = stage.world.envs * stage.learner.rollout
        assert stage.learner.steps <= record["steps"] < stage.learner.steps + update
        if recipe is not None:
            first = flat(yaml.safe_load(recipe.read_text())["stages"][0])
            assert set(chosen) - set(then) - MACHINE <= set(first)


def today(recorded: dict[str, Any]) -> dict[str, Any]:
    names = {old: TODAY.get(old, old) for old in recorded if old not in MACHINE}
    return {new: recorded[old] for old, new in names.items() if new is not None}


def flat(tree: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Leaves by their dotted path; tuples as lists."""
    leaves: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, dict):
            leaves |= flat(value, f"{above}{name}.")
        else:
            leaves[above + name] = list(value) if isinstance(value, tuple) else value
    return leaves
