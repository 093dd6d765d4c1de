"""What made-up walks come to, in numbers, on the screen and as a picture."""

import numpy as np
import pytest

from rmll_eval.conditions import Conditions
from rmll_eval.evaluation import Evaluation
from rmll_eval.evaluation_case import EvaluationCase
from rmll_eval.evaluation_report import PaperComparison
from rmll_eval.picture import picture
from rmll_eval.tables import show
from rmll_eval.walk_metrics import ADHERENCE, ENERGY, VX_ERROR, WalkMetrics, fallen, mean, worst


def walk(vx: float = 0.5, frequency: float = 6.0, **figures) -> WalkMetrics:
    known = {
        "adherence": 1.0, "off_spec_contact": 0.0, "vx_error": 0.1, "wz_error": 0.1,
        "energy_per_metre": 50.0, "cost_of_transport": 0.4, "distance": 10.0, "falls": 0,
    }  # fmt: skip
    return WalkMetrics(EvaluationCase(vx, 0.0, frequency, 0), **known | figures)


def evaluation(
    *walks: WalkMetrics,
    gait: str = "trot",
    conditions: Conditions = Conditions(),  # noqa: B008 - frozen
) -> Evaluation:
    return Evaluation(gait, "trot.onnx", "emulator", 6.0, 0, conditions, walks)


def test_mean_energy_is_all_the_energy_over_all_the_way() -> None:
    walks = [walk(energy_per_metre=30.0, distance=30.0), walk(energy_per_metre=130.0)]
    assert mean(ENERGY, walks) == pytest.approx((30 * 30 + 130 * 10) / 40)
    assert worst(ENERGY, walks) == 130


def test_energy_on_the_spot_does_not_count() -> None:
    walks = [walk(), walk(vx=0.05, energy_per_metre=900.0)]
    assert (mean(ENERGY, walks), worst(ENERGY, walks)) == (50, 50)
    assert mean(ENERGY, walks[1:]) is worst(ENERGY, walks[1:]) is None


def test_the_worst_adherence_is_the_least_the_worst_error_the_greatest() -> None:
    walks = [walk(adherence=0.9, vx_error=0.2), walk(), walk(adherence=None, vx_error=None)]
    assert worst(ADHERENCE, walks) == 0.9
    assert worst(VX_ERROR, walks) == 0.2
    assert mean(ADHERENCE, walks) == pytest.approx(0.95)


def test_a_walk_with_many_touches_of_the_ground_is_one_with_a_fall() -> None:
    assert fallen([walk(falls=4), walk(), walk(falls=1)]) == 2


def test_the_papers_energy_is_compared_at_the_papers_speeds() -> None:
    walks = [walk(vx=1.0, energy_per_metre=40.0), walk(vx=0.25, energy_per_metre=400.0)]
    compared = evaluation(*walks).report().energy_at_the_papers_speeds
    # 2165.04 in the paper's table, summed over steps of 0.02 s
    assert compared == PaperComparison((0.5, 1.0), 1, 40.0, pytest.approx(43.3, abs=0.01))


def test_a_gait_that_the_paper_does_not_have_has_no_reference() -> None:
    pronk = evaluation(walk(), gait="pronk")
    assert pronk.report().energy_at_the_papers_speeds is None
    assert picture(pronk).axes[2].get_title() == "energy per metre [J/m]"


def test_other_ground_is_named_and_not_compared_with_the_papers_flat_one() -> None:
    found = evaluation(walk(), conditions=Conditions("rough", 5, pushes=True))
    assert found.title.startswith("trot in the emulator on rough ground of level 5 with pushes: 1")
    report = found.report()
    assert (report.ground, report.level, report.pushes) == ("rough", 5, True)
    assert report.energy_at_the_papers_speeds is None


def test_the_tables_name_metrics_with_their_units(capsys: pytest.CaptureFixture[str]) -> None:
    show(evaluation(walk(fault="tilted", falls=2), walk(vx=-0.5, stuck=True)), as_grid=True)
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "vx error [m/s] 0.10 0.10" in lines
    assert "energy per metre [J/m] at 0.5 to 1 m/s 50 50 43" in lines
    assert {"falls 1 of 2", "faults 1 of 2", "stuck 1 of 2"} <= set(lines)


def test_the_picture_shows_means_of_cells_and_marks_falls() -> None:
    walks = [
        walk(0.0, 6.0, adherence=0.8), walk(0.0, 6.0, adherence=0.6), walk(0.0, 8.0, falls=1),
        walk(0.5, 6.0, energy_per_metre=None), walk(0.5, 8.0),
    ]  # fmt: skip
    adherence, _, energy = picture(evaluation(*walks)).axes
    assert [text.get_text() for text in adherence.texts] == ["0.70", "1.00", "1.00", "1.00"]
    assert [text.get_text() for text in energy.texts] == ["-", "-", "-", "50"]
    corners = np.array([patch.get_xy() for patch in adherence.patches])
    assert np.round(corners).tolist() == [[1, 0]]
