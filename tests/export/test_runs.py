"""Which policy a gait means: by its rules, the finished before the stopped, none in silence."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rmll_common.errors import InputError
from rmll_export.runs import SHOWN, choose

SHIPPED = Path(__file__).parents[2] / "policies"
OWN = """
gait: trot
commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}
cycle: [FL BR, none, FR BL, none]
"""


@pytest.fixture
def own_trot(tmp_path: Path) -> Path:
    """A gait of other rules that bears the name of the library's."""
    path = tmp_path / "my_trot.yaml"
    path.write_text(OWN)
    return path


def test_the_newest_finished_run_comes_first_then_the_shipped_policy_then_what_was_stopped(
    run, tmp_path
):
    runs = tmp_path / "runs"
    chosen = choose("trot", runs, SHIPPED)
    assert (chosen.checkpoint, chosen.passed_over) == (SHIPPED / "trot.safetensors", [])
    stopped = run("1", finished=False, steps=1_200_000)
    chosen = choose("trot", runs, SHIPPED)
    assert chosen.checkpoint == SHIPPED / "trot.safetensors"
    assert chosen.passed_over == [f"{stopped}, stopped at 1.2 of 12 M steps"]
    chosen = choose("trot", runs)
    assert chosen.checkpoint == stopped
    assert chosen.why == "the newest run of trot, stopped at 1.2 of 12 M steps"
    run("2")
    newest = run("3")
    chosen = choose("trot", runs, SHIPPED)
    assert (chosen.checkpoint, chosen.why) == (newest, "the newest finished run of trot")
    assert chosen.passed_over == [f"{stopped}, stopped at 1.2 of 12 M steps"]


def test_a_gait_of_the_same_name_and_other_rules_stands_in_for_no_other(run, own_trot, tmp_path):
    runs = tmp_path / "runs"
    own = run("own", rules=own_trot)
    chosen = choose("trot", runs, SHIPPED)
    assert chosen.checkpoint == SHIPPED / "trot.safetensors"
    assert chosen.passed_over == [f"{own}, finished: other rules than trot"]
    chosen = choose(str(own_trot), runs, SHIPPED)
    assert chosen.checkpoint == own
    (reason,) = chosen.passed_over
    assert reason == f"{SHIPPED}/trot.safetensors, shipped: other rules than {own_trot}"
    with pytest.raises(
        InputError, match=r"no run in .*runs/trot/ can be taken: .*own.*other rules"
    ):
        choose("trot", runs)


def test_what_a_gait_and_its_states_are_called_does_not_matter(run, tmp_path):
    """The library's trot in the long form, with its own names."""
    path = tmp_path / "diagonal.yaml"
    path.write_text(
        "gait: trot\ndescription: mine\n"
        "commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}\nstates:\n"
        "  left:\n    - {when: FL & BR & !FR & !BL, to: right}\n"
        "  right:\n    - {when: FR & BL & !FL & !BR, to: left}\n"
    )
    assert choose(str(path), tmp_path / "runs", SHIPPED).checkpoint.name == "trot.safetensors"
    path.write_text(path.read_text().replace("[6, 12]", "[6, 10]"))
    with pytest.raises(InputError, match=r"trot\.safetensors, shipped: other rules than "):
        choose(str(path), tmp_path / "runs", SHIPPED)


def test_a_name_without_a_file_means_the_rules_of_its_newest_run(run, own_trot, tmp_path):
    runs = tmp_path / "runs"
    older, newer = run("1", gait="canter"), run("2", gait="canter", rules=own_trot)
    chosen = choose("canter", runs, SHIPPED)
    assert chosen.checkpoint == newer
    assert chosen.passed_over == [f"{older}, finished: other rules than the newest"]


def test_what_cannot_be_read_is_passed_over(run, tmp_path):
    good, bad = run("1", gait="canter"), run("2", gait="canter")
    bad.write_bytes(b"half a file")
    (tmp_path / "runs" / "canter" / "3").mkdir()  # just begun
    chosen = choose("canter", tmp_path / "runs", SHIPPED)
    assert chosen.checkpoint == good
    assert len(chosen.passed_over) == 2
    assert any(f"{bad}: not a safetensors file" in reason for reason in chosen.passed_over)
    assert any(f"{bad.parent.parent}/3/" in reason for reason in chosen.passed_over)


def test_many_that_are_passed_over_are_counted(run, tmp_path):
    for number in range(SHOWN + 3):
        run(str(number), finished=False)
    told = choose("trot", tmp_path / "runs", SHIPPED).told().splitlines()
    assert len(told) == 1 + SHOWN + 1
    assert told[-1] == "passed over: 3 more"


def test_a_gait_that_nobody_trained_is_told_what_there_is(run, tmp_path):
    run("1", gait="canter")
    with pytest.raises(InputError, match=r"no policy of hop: .*; there are: .*canter.*, trot"):
        choose("hop", tmp_path / "runs", SHIPPED)
    with pytest.raises(InputError, match=r"no policy of hop: no run in .*; there are: canter$"):
        choose("hop", tmp_path / "runs")
    (tmp_path / "runs" / "hop" / "1").mkdir(parents=True)
    with pytest.raises(InputError, match=r"no run in .*runs/hop/ can be taken: .*No such file"):
        choose("hop", tmp_path / "runs")


def test_a_run_may_be_named_itself(run, tmp_path):
    stopped = run("1", finished=False, steps=3_000_000)
    for name in (stopped, stopped.parent):
        chosen = choose(str(name), tmp_path / "runs", SHIPPED)
        assert chosen.checkpoint == stopped
        assert chosen.why == "as named, stopped at 3 of 12 M steps"


def export(*flags: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    call = [sys.executable, "-m", "rmll_export.cli", *map(str, flags), "--policies", str(SHIPPED)]
    return subprocess.run(call, cwd=cwd, capture_output=True, text=True)


@pytest.mark.parametrize("name", ["runs/trot", ".", "..", "runs/trot/2", "/"])
def test_a_path_that_is_no_run_is_told_so(run, tmp_path, monkeypatch, name):
    run("1")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"no run of rmll-train, which has a policy\.safetensors"):
        choose(name, Path("runs"), SHIPPED)


def test_a_provenance_of_another_hand_is_refused_in_one_line(run, tmp_path):
    path = run("1", shortfalls=5)
    with pytest.raises(InputError, match="safetensors: the shortfalls in its provenance"):
        choose(str(path), tmp_path / "runs")


def test_the_command_says_what_it_took_and_what_it_passed_over(run, own_trot, tmp_path):
    run("own", rules=own_trot)
    done = export("trot", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines() == [
        f"taken: {SHIPPED}/trot.safetensors, shipped",
        "passed over: runs/trot/own/policy.safetensors, finished: other rules than trot",
    ]
    assert (tmp_path / "trot.onnx").read_bytes() == (SHIPPED / "trot.onnx").read_bytes()
    done = export("--gait", "trot", "--json", cwd=tmp_path)
    report = json.loads(done.stdout)
    assert (report["why"], len(report["passed_over"])) == ("shipped", 1)


def test_a_folder_takes_the_bundle_under_its_own_name(tmp_path):
    folder = tmp_path / "bundles"
    folder.mkdir()
    done = export("trot", "--out", folder, "--card", folder, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in folder.iterdir()} == {"trot.onnx", "trot.md"}
    (tmp_path / "taken" / "trot.onnx").mkdir(parents=True)
    for bad, complaint in (
        ("taken", "--out taken: taken/trot.onnx is a folder"),
        ("no/x.onnx", "--out no/x.onnx: expected a file in a folder that exists"),
    ):
        done = export("trot", "--out", bad, cwd=tmp_path)
        assert (done.returncode, done.stderr) == (2, f"rmll-export: {complaint}\n")
    assert not list(tmp_path.glob("**/*.partial"))
    assert not list((tmp_path / "taken" / "trot.onnx").iterdir())


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        ((), "name a gait"),
        (("trot", "--gait", "pace"), "two gaits, trot and --gait pace: name one"),
        (("pace", "--checkpoint", SHIPPED / "trot.safetensors"), "holds gait 'trot', expected"),
        (("my_trot.yaml", "--checkpoint", SHIPPED / "trot.safetensors"),
         "its gait has other rules than my_trot.yaml"),
        (("none.yaml",), "none.yaml: cannot be read: No such file or directory"),
    ],
)  # fmt: skip
def test_what_the_command_refuses(own_trot, tmp_path, flags, complaint):
    done = export(*flags, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert complaint in done.stderr
    assert not list(tmp_path.glob("*.onnx*"))


def test_a_policy_that_is_not_useful_is_taken_with_a_word(tmp_path: Path, run) -> None:
    run("weak", shortfalls=("adherence 0.900, at least 0.95 wanted", "3 falls, none wanted"))
    told = choose("trot", tmp_path / "runs", SHIPPED).told()
    assert told.splitlines()[-1] == (
        "not useful yet: adherence 0.900, at least 0.95 wanted; 3 falls, none wanted"
    )
    done = export("trot", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["shortfalls"] == [
        "adherence 0.900, at least 0.95 wanted", "3 falls, none wanted",
    ]  # fmt: skip
    run("good")
    assert "useful" not in choose("trot", tmp_path / "runs", SHIPPED).told()
