"""Each limit alone ends a walk, and only beyond its value."""

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from rmll_robots import A1
from rmll_train.env.simulation import Simulation
from rmll_train.env.terminations import TIPPED, beyond_limits, down
from rmll_train.train_settings import Terminations

LIMIT = Terminations(
    base_down=0.1, knee_height=0.02, base_height=0.2, foot_height=0.15, joint_margin=0.05,
    joint_speed=1.0, action_rate=10.0,
)  # fmt: skip
FASTEST = A1.velocity_limit
UPPER, LOWER = torch.tensor(A1.joint_upper), torch.tensor(A1.joint_lower)


def standing(**different: Any) -> Simulation:
    """Two robots that break no limit; the second one is what ``different`` says."""
    plain = {
        "base_height": torch.full((2,), 0.3),
        "knee_height": torch.full((2, 4), 0.15),
        "foot_height": torch.zeros(2, 4),
        "projected_gravity": torch.tensor([[0.0, 0.0, -1.0]] * 2),
        "joint_position": torch.from_numpy(A1.stand_pose).repeat(2, 1),
        "joint_velocity": torch.zeros(2, 12).double(),
    }
    for name, (index, value) in different.items():
        plain[name][(1, *index)] = value
    facts = {"robot": A1, "joint_lower": LOWER, "joint_upper": UPPER}
    return cast(Simulation, SimpleNamespace(**plain, **facts))


@pytest.mark.parametrize(
    ("name", "index", "fine", "wrong"),
    [
        ("base_height", (), 0.101, 0.099),
        ("knee_height", (3,), 0.021, 0.019),
        ("projected_gravity", (2,), TIPPED - 0.01, TIPPED + 0.01),
    ],
)
def test_a_robot_is_down(name: str, index: tuple[int, ...], fine: float, wrong: float) -> None:
    assert down(standing(**{name: (index, fine)}), LIMIT).tolist() == [False, False]
    assert down(standing(**{name: (index, wrong)}), LIMIT).tolist() == [False, True]


@pytest.mark.parametrize(
    ("name", "index", "fine", "wrong"),
    [
        ("base_height", (), 0.201, 0.199),
        ("foot_height", (2,), 0.149, 0.151),
        ("joint_position", (5,), float(UPPER[5]) + 0.049, float(UPPER[5]) + 0.051),
        ("joint_position", (1,), float(LOWER[1]) - 0.049, float(LOWER[1]) - 0.051),
        ("joint_velocity", (11,), -FASTEST + 0.01, -FASTEST - 0.01),
    ],
)
def test_a_limit_is_broken(name: str, index: tuple[int, ...], fine: float, wrong: float) -> None:
    still = torch.zeros(2, 12)
    assert not beyond_limits(standing(**{name: (index, fine)}), LIMIT, still).any()
    assert beyond_limits(standing(**{name: (index, wrong)}), LIMIT, still).tolist() == [False, True]


def test_an_action_that_changes_too_much() -> None:
    change = torch.zeros(2, 12)
    change[0, :4], change[1, :4] = 2.49, -2.51
    assert beyond_limits(standing(), LIMIT, change).tolist() == [False, True]
