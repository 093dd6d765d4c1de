"""The recorder and its process: whatever happens to it, handing over a tick never hurts."""

import os
import re
import resource
import signal
import subprocess
import sys
import time
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from rmll_common.errors import Failure, InputError
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.recording import recorder as recorders
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.recorder import Recorder
from rmll_onboard.recording.recorder_process import record
from rmll_onboard.recording.telemetry import Tick
from rmll_onboard.settings.runtime_settings import RuntimeSettings

RANDOM = np.random.default_rng(0)


@pytest.fixture(scope="module")
def about(bundle_path):
    return describe(load_bundle(bundle_path), RuntimeSettings(), real_time=True)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """A machine with other work to do may take long to start a process."""
    monkeypatch.setattr(recorders, "PATIENCE", 120.0)


def tick(number: int, size: int = 771) -> Tick:
    """Noise, which does not pack."""
    return Tick(
        number, number * 5_000_000, [RANDOM.bytes(size)], RANDOM.bytes(610), None, (0.0, 0.0, 8.0),
        False, False, None,
    )  # fmt: skip


def wait_for(condition, what: str):
    deadline = time.monotonic() + 60
    while not (found := condition()):
        assert time.monotonic() < deadline, what
        time.sleep(0.02)
    return found


def ticks_in(path: Path) -> list[int]:
    """Numbers of the ticks that can be read at this moment."""
    try:
        return [found.number for found in FlightLog(path).ticks()]
    except InputError:  # not even the metadata is there
        return []


def test_all_ticks_arrive(about, tmp_path):
    path = tmp_path / "walk.mcap"
    with closing(Recorder(path, about, 1000)) as recorder:
        sent = [tick(number) for number in range(300)]
        for one in sent:
            recorder.keep(one)
    report = recorder.report()
    assert (report.file, report.dropped, report.ticks) == (str(path), 0, 300)
    assert report.megabytes == pytest.approx(path.stat().st_size / 1e6, abs=1e-3)
    assert report.trouble is None
    log = FlightLog(path)
    assert list(log.ticks()) == sent
    assert log.complete


@contextmanager
def largest_file(size: int):
    """A disk that is full for whoever is started in the block: files may not grow further."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_told_and_costs_only_the_recording(about, tmp_path, capfd):
    path = tmp_path / "walk.mcap"
    with largest_file(200_000):
        recorder = Recorder(path, about, 1000)
    with closing(recorder):
        number = 0

        def keep_until_it_has_ended():
            nonlocal number
            recorder.keep(tick(number))
            number += 1
            return recorder.dropped

        wait_for(keep_until_it_has_ended, "the process still takes ticks")
    assert recorder.report().trouble == f"{path}: File too large"
    assert recorder.report().dropped > 0
    assert capfd.readouterr().err == f"rmll-onboard: no recording: {path}: File too large\n"


@pytest.mark.parametrize(
    ("name", "trouble"),
    [("missing/walk.mcap", "No such file or directory"), ("there.mcap", "File exists")],
)
def test_a_file_that_cannot_be_made_is_told(about, tmp_path, capfd, name, trouble):
    (tmp_path / "there.mcap").write_text("precious")
    path = tmp_path / name
    with closing(Recorder(path, about, 1000)) as recorder:
        for number in range(10):
            recorder.keep(tick(number))
    assert recorder.report().trouble == f"{path}: {trouble}"
    assert capfd.readouterr().err == f"rmll-onboard: no recording: {path}: {trouble}\n"
    assert (tmp_path / "there.mcap").read_text() == "precious"


def test_a_killed_process_leaves_what_it_flushed(about, tmp_path):
    path = tmp_path / "walk.mcap"
    with closing(Recorder(path, about, 1000)) as recorder:
        for number in range(100):
            recorder.keep(tick(number))
        wait_for(lambda: len(ticks_in(path)) == 100, "nothing is flushed while it records")
        os.kill(recorder._process.pid, signal.SIGKILL)
        number = 100
        while not recorder.dropped:
            recorder.keep(tick(number))
            number += 1
            time.sleep(0.001)
    assert ticks_in(path) == list(range(100))
    assert recorder.report().trouble == "the recording process died"


def test_a_process_that_stands_still_holds_up_nobody(about, tmp_path, monkeypatch):
    """What it cannot take is kept for it, and from a certain amount on dropped and counted."""
    monkeypatch.setattr(recorders, "_WAITING_LIMIT", 2_000_000)
    path = tmp_path / "walk.mcap"
    with closing(Recorder(path, about, 1000)) as recorder:
        recorder.keep(tick(0))
        wait_for(lambda: ticks_in(path) == [0], "it does not begin")
        os.kill(recorder._process.pid, signal.SIGSTOP)
        try:
            number = 1
            while recorder.dropped < 10:
                recorder.keep(tick(number))
                number += 1
        finally:
            os.kill(recorder._process.pid, signal.SIGCONT)
    assert number > 1000
    assert ticks_in(path) == list(range(number - recorder.dropped))
    assert recorder.report().trouble is None


def test_a_process_that_never_ends_is_given_up(about, tmp_path, monkeypatch):
    monkeypatch.setattr(recorders, "PATIENCE", 0.2)
    recorder = Recorder(tmp_path / "walk.mcap", about, 1000)
    os.kill(recorder._process.pid, signal.SIGSTOP)
    for number in range(3000):
        recorder.keep(tick(number))
    recorder.close()
    assert recorder._process.returncode == -signal.SIGKILL
    assert recorder.report().trouble == "the recording process died"


def test_the_disk_is_bounded_and_the_newest_is_kept(about, tmp_path):
    path = tmp_path / "walk.mcap"
    with closing(Recorder(path, about, max_mb=6.0)) as recorder:
        for number in range(300):
            recorder.keep(tick(number, size=40_000))
    before = tmp_path / "walk.before.mcap"
    assert sorted(tmp_path.iterdir()) == [before, path]
    assert recorder.report().dropped == 0
    assert before.stat().st_size + path.stat().st_size < 8e6  # a page ends with a whole chunk
    numbers = ticks_in(before) + ticks_in(path)
    assert numbers == list(range(numbers[0], 300))
    assert 75 < len(numbers) < 300
    # each page can be read by itself
    assert FlightLog(path).about == FlightLog(before).about == about


def test_an_older_page_is_not_overwritten(about, tmp_path):
    (tmp_path / "walk.before.mcap").write_text("precious")
    with closing(Recorder(tmp_path / "walk.mcap", about, 8.0)) as recorder:
        pass
    assert "walk.before.mcap: File exists" in recorder.report().trouble


def test_signals_for_the_daemon_do_not_end_the_recording(about, tmp_path):
    path = tmp_path / "walk.mcap"
    with closing(Recorder(path, about, 1000)) as recorder:
        recorder.keep(tick(0))
        wait_for(lambda: ticks_in(path), "it does not begin")
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(recorder._process.pid, number)
        recorder.keep(tick(1))
    assert ticks_in(path) == [0, 1]
    assert recorder.report().trouble is None


def test_a_killed_daemon_loses_nothing_that_it_handed_over(bundle_path, tmp_path):
    """The recording process notices, and gives the file its proper end."""
    path = tmp_path / "walk.mcap"
    script = f"""
import os, signal
from pathlib import Path
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.recording.recorder import Recorder
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.recording.telemetry import Tick
about = describe(load_bundle(Path({str(bundle_path)!r})), RuntimeSettings(), real_time=True)
recorder = Recorder(Path({str(path)!r}), about, 1000)
for number in range(300):
    recorder.keep(Tick(number, number, [], bytes(610), None, (0.0, 0.0, 8.0), False, False, None))
os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
    assert killed.returncode == -signal.SIGKILL

    def whole():
        if not path.exists():
            return False
        try:
            log = FlightLog(path)
            numbers = [found.number for found in log.ticks()]
        except InputError:
            return False
        return numbers if log.complete else False

    assert wait_for(whole, "the file has no end") == list(range(300))


def test_a_folder_is_given_a_file_of_gait_and_time(tmp_path):
    path = recorders.log_path(tmp_path, "trot")
    assert path.parent == tmp_path
    assert re.fullmatch(r"trot-\d{8}-\d{6}\.mcap", path.name)
    assert recorders.log_path(tmp_path / "walk.mcap", "trot") == tmp_path / "walk.mcap"


def test_what_was_not_foreseen_is_one_line_too(tmp_path):
    reading, writing = os.pipe()
    os.write(writing, recorders.LENGTH.pack(4) + b"junk")
    os.close(writing)
    told = record(reading, tmp_path / "walk.mcap", 1e9)
    os.close(reading)
    assert told.ticks == 0
    assert told.trouble.startswith(f"{tmp_path / 'walk.mcap'}: ValidationError(")


def test_without_the_library_it_says_what_to_install(about, tmp_path, monkeypatch):
    monkeypatch.setattr(recorders, "find_spec", lambda name: None)
    with pytest.raises(Failure, match=r"mcap is not installed; run: pip install 'rmll\[record\]'"):
        Recorder(tmp_path / "walk.mcap", about, 1000)
