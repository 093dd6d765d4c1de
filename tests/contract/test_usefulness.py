"""When a policy is useful, and what standing still would be worth."""

import numpy as np
import pytest

from rmll_contract.usefulness import share, shortfalls, standing_error
from rmll_gaits.table import Commands

FULL = Commands(vx=(-1.0, 1.0), wz=(-1.0, 1.0), frequency=(6.0, 12.0))
GOOD = {"adherence": 0.96, "vx_error": 0.09, "wz_error": 0.19, "falls": 0.0}


@pytest.mark.parametrize(
    "commanded", [(-1.0, 1.0), (-0.5, 0.5), (0.2, 1.0), (-1.0, -0.5), (-0.2, 1.0), (0.0, 0.0)]
)
def test_a_standing_robots_error_is_the_mean_of_what_it_is_told(
    commanded: tuple[float, float],
) -> None:
    drawn = np.linspace(*commanded, 100_001)
    assert standing_error(commanded) == pytest.approx(np.abs(drawn).mean(), abs=1e-4)


def test_an_error_is_told_as_a_share_of_it() -> None:
    assert share(0.125, (-0.5, 0.5)) == pytest.approx(0.5)
    assert share(0.1, (0.0, 0.0)) == float("inf")


def test_a_robot_that_follows_keeps_its_rhythm_and_stands_up_is_useful() -> None:
    assert shortfalls(GOOD, FULL) == []


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [("adherence", 0.94, "adherence 0.940, at least 0.95"),
     ("vx_error", 0.11, "vx error 0.110 m/s, at most 0.10"),
     ("vx_error", float("nan"), "vx error nan"),
     ("wz_error", 0.21, "wz error 0.210 rad/s, at most 0.20"),
     ("falls", 1.0, "falls: 1, none wanted")],
)  # fmt: skip
def test_what_falls_short_is_said(name: str, value: float, told: str) -> None:
    (text,) = shortfalls(GOOD | {name: value}, FULL)
    assert text.startswith(told)


def test_stepping_on_the_spot_is_not_useful_however_well_it_adheres() -> None:
    slow = Commands(vx=(-0.5, 0.5), wz=(-0.5, 0.5), frequency=(6.0, 12.0))
    on_the_spot = {"adherence": 1.0, "vx_error": 0.2, "wz_error": 0.25, "falls": 0.0}
    assert [text.split()[0] for text in shortfalls(on_the_spot, slow)] == ["vx", "wz"]
    assert shortfalls(GOOD, slow)[0].startswith("vx error 0.090 m/s, at most 0.05")
