"""The project's figures from sums over robots and steps."""

from dataclasses import fields

import pytest
import torch

from rmll_train.env.episode_metrics import EpisodeMetrics


def sums(robots: int = 2, **values: list[float]) -> EpisodeMetrics:
    made = EpisodeMetrics.zeros(robots)
    for name, value in values.items():
        setattr(made, name, torch.tensor(value))
    return made


def test_means_are_over_steps_and_ratios_over_totals() -> None:
    told = sums(
        steps=[100, 300], transitions=[9, 31], allowed=[20, 30], off_spec=[10, 30],
        vx_error=[4, 36], wz_error=[40, 0], energy=[300, 100], distance=[1, 3],
        walk_reward=[2, 2], level=[100, 600], episodes=[1, 3], ends=[0, 1], falls=[0, 1],
        length=[100, 300],
    ).metrics()  # fmt: skip
    assert told == pytest.approx(
        {
            "adherence": 0.8, "off_spec_contact": 0.1, "vx_error": 0.1, "wz_error": 0.1,
            "energy_per_metre": 100, "walk_reward": 0.01, "level": 1.75, "early_ends": 0.25,
            "falls": 1, "episode_steps": 100,
        }
    )  # fmt: skip


def test_nothing_seen_is_no_division_by_zero() -> None:
    assert all(value == 0 for value in sums().metrics().values())


def test_one_robot_has_its_own_figures() -> None:
    both = sums(steps=[10, 20], transitions=[1, 4], allowed=[2, 4])
    assert [both.robot(i).metrics()["adherence"] for i in range(2)] == [0.5, 1.0]
    assert all(len(getattr(both.robot(1), field.name)) == 1 for field in fields(both))
