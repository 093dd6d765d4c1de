import pytest

from rmll_common.errors import InputError
from rmll_eval.evaluation_case import draw, grid
from rmll_gaits.table import Commands

WALK = Commands(vx=(-0.5, 0.5), wz=(-0.4, 0.4), frequency=(5, 10))


def test_a_grid_covers_what_was_trained() -> None:
    trials = grid(WALK, (), (), 1, 0)
    assert {t.frequency for t in trials} == {5, 6, 7, 8, 9, 10}
    speeds = sorted({t.vx for t in trials})
    assert (speeds[0], speeds[-1]) == WALK.vx and 0 in speeds
    assert len(trials) == len(speeds) * 6
    assert {t.wz for t in trials} == {0}


def test_every_walk_has_a_seed_of_its_own() -> None:
    trials = grid(WALK, (0.1, 0.5), (6,), 3, 100)
    assert [t.vx for t in trials] == [0.1] * 3 + [0.5] * 3
    assert [t.seed for t in trials] == list(range(100, 106))
    assert [t.seed for t in draw(WALK, 3, 7)] == [7, 8, 9]


def test_drawn_commands_are_spread_over_what_was_trained_and_follow_the_seed() -> None:
    trials = draw(WALK, 300, 1)
    for name in ("vx", "wz", "frequency"):
        low, high = getattr(WALK, name)
        values = [getattr(trial, name) for trial in trials]
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high >= max(values) > high - 0.1 * (high - low)
    assert {t.frequency for t in trials} == {5, 6, 7, 8, 9, 10}
    assert draw(WALK, 300, 1) == trials != draw(WALK, 300, 2)


@pytest.mark.parametrize(
    ("speeds", "frequencies", "complaint"),
    [
        ((0.2, 0.6), (), "--speeds 0.6: this gait was trained for -0.5 to 0.5"),
        ((float("nan"),), (), "--speeds nan"),
        ((), (4,), "--frequencies 4: this gait was trained for 5 to 10"),
    ],
)
def test_what_was_not_trained_is_refused(speeds: tuple, frequencies: tuple, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        grid(WALK, speeds, frequencies, 1, 0)
