"""Settings files: exact round trips, and one clear line for what is wrong."""

from pathlib import Path

import pytest

import rmll_train
from rmll_common.errors import InputError
from rmll_train.train_settings import (
    EnvSettings,
    LearnerSettings,
    TrainSettings,
    load,
    paper,
    to_yaml,
)

EXPERIMENTS = sorted((Path(rmll_train.__file__).parent / "experiments").glob("*.yaml"))


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "settings",
    [
        TrainSettings(),
        paper(TrainSettings(gait="pace", seed=3)),
        TrainSettings(
            gait="1e3", learner=LearnerSettings(learning_rate=1e-05, gamma=1e16, hidden=(1, 1))
        ),
        TrainSettings(
            gait="010.yaml", seed=10**9, learner=LearnerSettings(rate_range=(2.5e-7, 1e-5))
        ),
    ],
)
def test_a_run_can_be_told_again_from_its_settings_file(
    tmp_path: Path, settings: TrainSettings
) -> None:
    assert load(write(tmp_path, to_yaml(settings)), TrainSettings()) == settings


def test_a_file_names_only_what_differs(tmp_path: Path) -> None:
    path = write(tmp_path, "world: {rewards: {power: -0.5}}\n")
    changed = load(path, TrainSettings())
    assert changed.world.rewards.power == -0.5
    assert changed.learner == TrainSettings().learner


def test_numbers_may_have_an_exponent(tmp_path: Path) -> None:
    text = "learner: {learning_rate: 1e-3, steps: 3e6}\nworld: {rewards: {bonus: 1e3}}"
    found = load(write(tmp_path, text), TrainSettings())
    assert (found.learner.learning_rate, found.learner.steps) == (0.001, 3_000_000)
    assert (found.world.rewards.bonus, type(found.world.rewards.bonus)) == (1000.0, float)


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: path.name)
def test_every_experiment_can_be_loaded(path: Path) -> None:
    load(path, TrainSettings()).check()


@pytest.mark.parametrize("text, value", [("auto", "auto"), ("on", True), ("off", False)])
def test_symmetry_is_on_off_or_where_the_gait_allows_it(
    tmp_path: Path, text: str, value: bool | str
) -> None:
    path = write(tmp_path, f"learner: {{symmetry: {text}}}\n")
    assert load(path, TrainSettings()).learner.symmetry == value


@pytest.mark.parametrize(
    "text, expected",
    [
        ("wrld: {}", ":1:1: unknown key 'wrld', expected one of gait, seed, world, learner"),
        ("world: {rewards: {torqe: 1}}", ":1:19: unknown key 'torqe', expected one of velocity_x"),
        ("world: 3", ":1:8: found '3', expected a mapping"),
        ("learner: {epochs: many}", ":1:19: found 'many', expected a whole number"),
        ("learner: {hidden: [1, a]}", ":1:23: found 'a', expected a whole number"),
        ("learner: {symmetry: 3}", ":1:21: found '3', expected one of auto, true, false"),
        ("learner: {gamma: 0.9, gamma: 0.8}", ":1:23: key 'gamma' is given twice"),
        ("learner: {steps: 12_000}", ":1:18: found 12_000, which readers of YAML take differently"),
        ("world: {profile: lidar}", ":1:18: found 'lidar', expected one of paper, imu"),
        ("- 1", ":1:1: found a list, expected a mapping"),
        ("a: [", ":1:5: not YAML"),
    ],
)
def test_bad_settings_are_one_clear_line(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(InputError) as error:
        load(write(tmp_path, text), TrainSettings())
    assert expected in str(error.value) and "mine.yaml" in str(error.value)


def test_sizes_that_cannot_work_are_refused() -> None:
    for world, learner in (
        (EnvSettings(envs=0), LearnerSettings()),
        (EnvSettings(envs=1), LearnerSettings(rollout=2)),
        (EnvSettings(), LearnerSettings(epochs=1, critic_epochs=2)),
    ):
        with pytest.raises(InputError):
            TrainSettings(world=world, learner=learner).check()
    TrainSettings().check()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("world: {envs: 100000000}", "world.envs is 100000000, expected at most 65536"),
        ("learner: {rollout: 1000000}", "robots x 1000000 steps are more than 16777216 samples"),
    ],
)
def test_sizes_that_no_memory_has_are_refused(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        load(write(tmp_path, text), TrainSettings()).check()
