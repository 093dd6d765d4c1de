import json
import sys

import numpy as np
import pytest

from rmll_gaits.load import library_names, load_gait
from rmll_gaits.table import MachineTable
from rmll_view.gait_cli import main

OVERLAP = """
gait: overlap
commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}
states:
  q0:
    - {when: FL, to: q0}
    - {when: FL & BR, to: q0}
"""


@pytest.fixture
def rmll_gait(monkeypatch, capsys):
    """Runs the command; its exit code, stdout and stderr."""
    monkeypatch.setenv("COLUMNS", "100")

    def command(*words):
        monkeypatch.setattr(sys, "argv", ["rmll-gait", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capsys.readouterr()

    return command


def test_check_prints_period_and_duty_factors(rmll_gait):
    code, out, _ = rmll_gait("check", *library_names(), "--frequency", 9)
    assert code == 0
    rows = [line.split() for line in out.splitlines()]
    assert ["three_one", "28", "0.56", "0.50", "0.50", "0.36", "0.36"] in rows


def test_the_table_has_its_units_and_fits_a_terminal(rmll_gait, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = rmll_gait("check", *library_names())
    head, *rows = out.splitlines()
    assert "period [steps]  period [s]" in head
    assert len(rows) == len(library_names())


def test_check_as_json_is_one_object(rmll_gait):
    code, out, _ = rmll_gait("check", "trot", "--json")
    assert code == 0
    assert json.loads(out)["trot"] == {
        "findings": [],
        "period": 0.36,
        "steps": [9, 9],
        "duty": dict.fromkeys(("FL", "FR", "BL", "BR"), 0.5),
    }


def test_check_reports_every_file_and_fails_if_one_has_an_error(rmll_gait, tmp_path):
    file = tmp_path / "overlap[red].yaml"
    file.write_text(OVERLAP)
    code, out, err = rmll_gait("check", file, "nonsense", "trot", "pronk")
    assert code == 2
    assert [line.split()[0] for line in out.splitlines()] == ["gait", "trot", "pronk"]
    assert "warning: pronk.yaml: pose none" in err
    errors = [line for line in err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 2
    assert f"{file}:7:14: state q0: contact FL BR opens two edges" in errors[0]
    assert "no gait 'nonsense'" in errors[1]
    code, out, _ = rmll_gait("check", file, "--json")
    assert code == 2
    assert json.loads(out)[str(file)]["findings"][0]["level"] == "error"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["check"], "expected a gait to check"),
        (["check", "trot", "--frequency", "0"], "--frequency 0: expected 1 to 1000"),
        (["show", "canter"], "no gait 'canter', expected one of bound"),
    ],
)
def test_bad_input_is_one_line_and_code_2(rmll_gait, words, message):
    code, out, err = rmll_gait(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1


def test_show_draws_the_gait_in_the_terminal(rmll_gait):
    code, out, _ = rmll_gait("show", "half_bound", "--frequency", 6)
    assert code == 0
    lines = [line.split() for line in out.splitlines()]
    assert ["q0", "(start)", "●", "●", "○", "○", "φ", "≥", "N", "q1"] in lines
    assert ["q1", "·", "·", "●", "·", "q_r", "(sink)"] in lines
    cycle = "█" * 6 + "·" * 6
    assert ["FL", cycle * 2 * 3] in lines
    assert ["BR", ("·" * 6 + "█" * 6 + "·" * 12) * 3] in lines


@pytest.mark.parametrize("frequency", [1, 9, 1000])
def test_the_terminal_s_width_is_kept(rmll_gait, frequency):
    _, out, _ = rmll_gait("show", "walk", "--frequency", frequency)
    assert max(map(len, out.splitlines())) <= 100


def test_show_as_json_is_the_compiled_table(rmll_gait):
    _, out, _ = rmll_gait("show", "half_bound", "--json")
    table = MachineTable.from_dict(json.loads(out))
    assert np.array_equal(table.effect, load_gait("half_bound").effect)


def test_show_draws_pictures(rmll_gait, tmp_path):
    svg, png = tmp_path / "gait.svg", tmp_path / "gait.png"
    code, out, _ = rmll_gait("show", "three_one", "--svg", svg, "--png", png)
    assert (code, out) == (0, "")
    assert png.read_bytes().startswith(b"\x89PNG")
    assert "<svg" in svg.read_text()


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--png", "x.jpg"], "--png x.jpg: expected a .png file in a folder that exists"),
        (["--svg", "x.png"], "--svg x.png: expected a .svg file in a folder that exists"),
        (["--svg", "no/x.svg"], "--svg no/x.svg: expected a .svg file in a folder that exists"),
        (["--png", "x.png", "--svg", "x"], "--svg x: expected a .svg file in a folder"),
    ],
)
def test_a_picture_is_what_its_name_says(rmll_gait, tmp_path, monkeypatch, words, complaint):
    monkeypatch.chdir(tmp_path)
    code, out, err = rmll_gait("show", "trot", *words)
    assert (code, out, err) == (2, "", err)
    assert complaint in err
    assert not list(tmp_path.iterdir())


def test_a_picture_may_be_written_into_a_folder(rmll_gait, tmp_path):
    assert rmll_gait("show", "trot", "--png", tmp_path)[0] == 0
    assert (tmp_path / "trot.png").read_bytes().startswith(b"\x89PNG")
