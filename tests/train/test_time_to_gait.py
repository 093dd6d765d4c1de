"""The table of how long gaits take: when a level counts as held, and that it goes on."""

from pathlib import Path

import pytest

from rmll_common.errors import InputError
from rmll_train import time_to_gait
from rmll_train.periodic_evaluation import Judgement
from rmll_train.time_to_gait import LEVELS, WITHOUT, Emergence, EvaluationPoint, held, measure
from rmll_train.train_settings import TrainSettings, overlaid


def test_a_level_is_held_from_the_first_of_two_judgements_in_a_row() -> None:
    seen = [
        EvaluationPoint(number, number / 10, Judgement({"adherence": adherence}, [], []))
        for number, adherence in enumerate((0.96, 0.5, 0.97, 0.96), 1)
    ]
    level = LEVELS["adherence 0.95"]
    assert held(seen, level) is seen[2]
    assert held(seen[:3], level) is None
    assert held([], level) is None


@pytest.mark.parametrize("name", [name for name in WITHOUT if name])
def test_each_departure_can_be_turned_off(name: str) -> None:
    assert overlaid(TrainSettings(), WITHOUT[name], name) != TrainSettings()


def test_an_interrupted_table_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def trained(gait: str, seed: int, without: str, limit: int, say: object) -> Emergence:
        asked.append((gait, seed))
        if len(asked) == 2:
            raise KeyboardInterrupt
        return Emergence(
            gait, seed, without, "abc", True, [1, None], [0.1, None], 0.93, 0.2, 0.3, 1000
        )

    monkeypatch.setattr(time_to_gait, "time_to_gait", trained)
    out = tmp_path / "table.jsonl"
    with pytest.raises(KeyboardInterrupt):
        measure(gaits=("trot", "walk"), seeds=(0,), out=out)
    measure(gaits=("trot", "walk"), seeds=(0,), out=out)
    assert asked == [("trot", 0), ("walk", 0), ("walk", 0)]
    assert len(out.read_text().splitlines()) == 2


def test_an_unknown_departure_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--without magic: known: all, .*symmetry"):
        measure(without=("magic",), out=tmp_path / "table.jsonl")
