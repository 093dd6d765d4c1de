"""Made-up logs of walks whose judgement is known."""

import json
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from rmll_common.errors import InputError
from rmll_eval.conformance import conformance, walks
from rmll_gaits.load import load_gait
from rmll_gaits.pose import to_label
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.recording.log_metadata import FORMAT, LogMetadata, versions
from rmll_onboard.recording.mcap_writer import log_file
from rmll_onboard.recording.telemetry import ControllerSample, Tick

TROT = load_gait("trot")
FIRST, SECOND = to_label("FL BR"), to_label("FR BL")
STEP = 20_000_000


def about() -> LogMetadata:
    return LogMetadata(
        format=FORMAT, gait="trot", policy="trot.onnx", digest="", control_hz=200, settings={},
        table=TROT.to_dict(), columns=[], arguments=[], versions=versions(), started="",
        unix_offset_ns=0,
    )  # fmt: skip


def write(path: Path, steps: list[tuple], c_f: float = 8.0) -> FlightLog:
    """A log with a tick each policy step: (label, state, phi), or a mode in which it rests."""
    with log_file(path, about()) as file:
        for number, step in enumerate(steps):
            if step is None:  # the recorder has dropped it
                continue
            resting = isinstance(step, str)
            mode, (label, state, phi) = (step, (15, 0, 0)) if resting else ("walking", step)
            command = (0.0, 0.0, 0.0 if resting else c_f)
            inside = ControllerSample(mode, "", label, state, phi, False, False, command, b"")
            tick = Tick(number, number * STEP, [], b"", None, command, False, False, inside)
            file.add(tick)
    return FlightLog(path)


def trot(cycles: int, dwell: int = 8) -> list[tuple]:
    """As the daemon would log it: the step that only looks, then each diagonal ``dwell`` steps."""
    steps: list[tuple] = [(15, 0, 0)]
    for count in range(2 * cycles):
        state, label = ((0, FIRST), (1, SECOND))[count % 2]
        steps += [(15 - label, state, phi) for phi in range(1, dwell)] + [(label, 1 - state, 0)]
    return steps


def judged(log: FlightLog):
    return conformance(walks(log), TROT)


def test_a_perfect_trot(tmp_path):
    found = judged(write(tmp_path / "log.mcap", ["standing", *trot(10), "standing"]))
    assert (found.walks, found.transitions, found.contradictions) == (1, 20, 0)
    assert found.seconds == pytest.approx(161 * 0.02)
    assert found.adherence == pytest.approx(20 / (161 / 8))
    assert found.cycle_rate == pytest.approx(found.cycle_rate_allowed) == pytest.approx(1 / 0.32)
    assert found.cycles == 9
    assert {name: (d.visits, d.least, d.most, d.allowed) for name, d in found.dwell.items()} == {
        "q0": (10, 8, 8, 8),
        "q1": (10, 8, 8, 8),
    }
    assert found.off_spec_contact == 0


def test_a_slow_and_sloppy_trot(tmp_path):
    steps = trot(10, dwell=12)
    sloppy = [(0, state, phi) if phi == 3 else (label, state, phi) for label, state, phi in steps]
    found = judged(write(tmp_path / "log.mcap", sloppy))
    assert found.adherence == pytest.approx(8 / 12, rel=0.02)
    assert found.cycle_rate == pytest.approx(1 / 0.48)
    assert found.cycle_rate < found.cycle_rate_allowed
    assert found.dwell["q1"].mean == 12
    assert found.off_spec_contact == pytest.approx(20 / len(steps))
    assert found.off_spec_steps == {"q0: none": 10, "q1: none": 10}


def test_a_log_that_says_something_else_is_contradicted(tmp_path):
    steps = trot(5)
    steps[40:44] = [(label, 1 - state, phi) for label, state, phi in steps[40:44]]
    assert judged(write(tmp_path / "log.mcap", steps)).contradictions == 4


def test_walks_and_gaps_are_judged_one_by_one(tmp_path):
    """After a gap the automaton goes on where the daemon says that it was."""
    steps = [*trot(5), "standing", *trot(5)]
    steps[20:30] = [None] * 10
    log = write(tmp_path / "log.mcap", steps)
    assert [len(walk.times) for walk in walks(log)] == [20, 51, 81]
    assert judged(log).contradictions == 0


def test_a_damaged_chunk_splits_a_walk_and_is_told(tmp_path):
    path = tmp_path / "log.mcap"
    with log_file(path, about()) as file:
        for number, step in enumerate(trot(10)):
            inside = ControllerSample("walking", "", *step, False, False, (0.0, 0.0, 8.0), b"")
            tick = Tick(number, number * STEP, [], b"", None, (0.0, 0.0, 8.0), False, False, inside)
            file.add(tick)
            if number in (60, 100):
                file.flush()
    data = bytearray(path.read_bytes())
    middle = [found.start() for found in re.finditer(b"zstd", data)][1]
    data[middle + 100] ^= 1
    path.write_bytes(data)
    log = FlightLog(path)
    assert [len(walk.times) for walk in walks(log)] == [61, 60]
    assert judged(log).contradictions == 0
    done = command("log.mcap", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "missing in the log: tick 61 to 101, 1.200 to 2.040 s\n" in done.stdout
    assert "messages that cannot be read: 80\n" in done.stdout
    found = json.loads(command("log.mcap", "--json", cwd=tmp_path).stdout)
    assert found["gaps"] == [{"first": 61, "last": 101, "start": 1.2, "end": 2.04}]
    assert (found["walks"], found["lost"]) == (2, 80)


def test_a_log_without_a_walk_or_with_a_strange_one_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"log\.mcap: the robot does not walk in it"):
        walks(write(tmp_path / "log.mcap", ["standing"] * 5))
    with pytest.raises(InputError, match=r"lost\.mcap: walks with a c_f of 0"):
        walks(write(tmp_path / "lost.mcap", trot(2), c_f=0.0))
    slow = about().table | {"dwell": [[1e308] * 16] * TROT.num_states}
    with log_file(tmp_path / "slow.mcap", msgspec.structs.replace(about(), table=slow)):
        pass
    with pytest.raises(InputError, match=r"slow\.mcap: its gait dwells 1e\+308 times c_f"):
        walks(FlightLog(tmp_path / "slow.mcap"))
    strange = ControllerSample("walking", "", 0, 0, 0, False, False, (0.0, 0.0, 8.0), b"")
    with log_file(tmp_path / "odd.mcap", about()) as file:
        file.add(Tick(0, 0, [], b"", None, (0.0, 0.0, 0.0), False, False, strange))
    data = (tmp_path / "odd.mcap").read_bytes()
    other = json.dumps(["q0", "q1"]).replace(" ", "").encode()
    assert other in data
    (tmp_path / "odd.mcap").write_bytes(data.replace(other, b'["x0","q1"]'))
    with pytest.raises(InputError, match=r"odd\.mcap: state 'q0' is none of the gait's"):
        walks(FlightLog(tmp_path / "odd.mcap"))


def command(*flags: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "rmll_eval.cli", "conformance", *map(str, flags)]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True)


def test_the_command_prints_one_object_and_leaves_a_picture(tmp_path):
    write(tmp_path / "log.mcap", trot(10))
    done = command("log.mcap", "--json", "--out", "contacts.png", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "contacts.png\n")
    assert json.loads(done.stdout)["transitions"] == 20
    assert (tmp_path / "contacts.png").read_bytes().startswith(b"\x89PNG")
    (tmp_path / "bad.mcap").write_bytes(b"nonsense")
    done = command("bad.mcap", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "rmll-eval: bad.mcap: not an MCAP file\n"
