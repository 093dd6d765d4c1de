"""Recorded walks through today's daemon."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
import yaml

from rmll_common.errors import InputError
from rmll_hil.replay.replay import differences, find_bundle, replay
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_hil.robot.can_robot import CanRobot
from rmll_hil.robot.emulator import Emulator
from rmll_hil.runs import lockstep
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.protocol.a1_packets import encode_command
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.mcap_writer import log_file
from rmll_onboard.recording.telemetry import Tick
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.tick_listener import TickListener
from rmll_onboard.settings.runtime_settings import LinkSettings, Motion, RuntimeSettings, Safety
from rmll_onboard.state.robot_state import MotorCommand
from rmll_robots import A1

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
BRISK = RuntimeSettings(
    motion=Motion(crouch=0.1, rise=0.3, settle=0.1, slow_down=0.2, sit=0.2),
    safety=Safety(stuck=100),  # a policy that stands makes no transitions
)


@pytest.fixture(scope="module")
def about(standing):
    return describe(load_bundle(standing), BRISK, real_time=False)


@pytest.fixture(scope="module")
def walked(standing) -> list[Tick]:
    """Told to end after a second and a half, as by Ctrl-C."""
    bundle = load_bundle(standing)
    emulator, ticks, datagrams = Emulator(), [], []
    daemon = Daemon(bundle, BRISK, FlagOperator(bundle.table.commands))
    listener = TickListener(daemon, ticks.append)
    while not daemon.finished:
        now = emulator.now_ms * 1_000_000
        answer = daemon.tick(now, datagrams)
        listener.observe(now, datagrams, answer)
        emulator.receive(answer)
        emulator.advance(5, now)
        datagrams = [emulator.state_datagram()]
        daemon.stopping = emulator.now_ms >= 1500
    return ticks


def write(path: Path, about, ticks: list[Tick]) -> FlightLog:
    with log_file(path, about) as file:
        for tick in ticks:
            file.add(tick)
    return FlightLog(path)


def through(log: FlightLog, bundle: Path):
    return replay(log, load_bundle(bundle), lambda _: None)


def test_a_walk_that_was_stopped_replays(walked, about, standing, tmp_path):
    assert any(tick.stopping for tick in walked)
    found = through(write(tmp_path / "log.mcap", about, walked), standing)
    assert found.identical and found.complete
    assert (found.ticks, found.remarks) == (len(walked), [])
    # and it is the recorded order that did it
    awake = [msgspec.structs.replace(tick, stopping=False) for tick in walked]
    found = through(write(tmp_path / "awake.mcap", about, awake), standing)
    assert found.different > 0
    assert found.first and found.first.seconds >= 1.5


def test_the_first_difference_is_shown_field_by_field(walked, about, standing, tmp_path):
    command = A1BoardPackets().decode_command(walked[200].answer)
    command.q[4] += 0.25
    odd = msgspec.structs.replace(walked[200], answer=encode_command(command))
    later = msgspec.structs.replace(walked[300], answer=bytes(610))
    ticks = [*walked[:200], odd, *walked[201:300], later, *walked[301:]]
    found = through(write(tmp_path / "log.mcap", about, ticks), standing)
    assert found.different == 2
    assert found.first is not None
    assert (found.first.tick, found.first.seconds) == (200, pytest.approx(1.0))
    assert [field.name for field in found.first.fields] == ["FL_thigh_joint.q", "crc"]
    q = found.first.fields[0]
    assert float(q.recorded) - float(q.replayed) == pytest.approx(0.25, abs=1e-5)
    assert found.largest == np.inf  # the other one differs in more than its targets


def test_how_far_targets_are_apart(walked, about, standing, tmp_path):
    command = A1BoardPackets().decode_command(walked[200].answer)
    command.q[4] += 0.001
    odd = msgspec.structs.replace(walked[200], answer=encode_command(command))
    ticks = [*walked[:200], odd, *walked[201:]]
    found = through(write(tmp_path / "log.mcap", about, ticks), standing)
    assert (found.different, found.largest) == (1, pytest.approx(0.001, abs=1e-6))


def test_every_field_can_differ():
    plain = encode_command(MotorCommand())
    fields = list(differences(plain, bytes(610), A1.joint_names))
    assert {"level", "crc", "motor[12].q", "motor[19].mode"} <= {field.name for field in fields}
    assert list(differences(plain, plain, A1.joint_names)) == []
    assert [f.name for f in differences(b"\x01\x02\x03", b"\x01\x00\x03\x04", ())] == [
        "length",
        "byte 1",
    ]


def test_a_log_with_a_hole_is_replayed_up_to_it(walked, about, standing, tmp_path):
    ticks = [*walked[:120], *walked[125:]]
    found = through(write(tmp_path / "log.mcap", about, ticks), standing)
    assert (found.ticks, found.missing, found.different) == (120, 120, 0)
    assert not found.identical
    found = through(write(tmp_path / "late.mcap", about, walked[10:]), standing)
    assert (found.ticks, found.missing) == (0, 0)


def damaged(path: Path, about, ticks: list[Tick], at: int, until: int) -> FlightLog:
    """A log of three chunks, the middle one of which cannot be read."""
    with log_file(path, about) as file:
        for tick in ticks:
            file.add(tick)
            if tick.number + 1 in (at, until):
                file.flush()
    data = bytearray(path.read_bytes())
    middle = [found.start() for found in re.finditer(b"zstd", data)][1]
    data[middle + 100] ^= 1
    path.write_bytes(data)
    return FlightLog(path)


def test_a_damaged_chunk_ends_the_comparison_and_what_is_missing_is_told(
    walked, about, standing, tmp_path
):
    """What the daemon had come to by then is not known, so nothing after the gap is compared."""
    found = through(damaged(tmp_path / "log.mcap", about, walked, 100, 200), standing)
    # the first tick after it may lack datagrams, and does not count
    after = len(walked) - 201
    assert (found.ticks, found.missing, found.not_compared) == (100, 100, after)
    assert [str(gap) for gap in found.gaps] == ["tick 100 to 200, 0.495 to 1.005 s"]
    assert found.different == 0 and found.complete and found.lost and found.lost >= 200
    done = command("log.mcap", "--policy", standing, cwd=tmp_path)
    assert done.returncode == 1
    assert "missing in the log: tick 100 to 200, 0.495 to 1.005 s\n" in done.stdout
    assert f"messages that cannot be read: {found.lost}\n" in done.stdout
    assert done.stderr.endswith(
        "rmll-hil: tick 100 is missing in the log, the replay ends there; "
        f"{after} ticks after it were not compared\n"
    )
    found = through(damaged(tmp_path / "end.mcap", about, walked, 100, len(walked)), standing)
    assert (found.ticks, found.missing, found.not_compared) == (100, 100, 0)
    assert [str(gap) for gap in found.gaps] == ["tick 100 and on, from 0.495 s"]
    assert not found.identical


def test_what_differs_from_then_is_remarked(walked, about, standing, tmp_path):
    other = msgspec.structs.replace(
        about, digest="0" * 64, versions=about.versions | {"cpu": "Abacus"}
    )
    found = through(write(tmp_path / "log.mcap", other, walked), standing)
    assert found.identical
    assert found.remarks[0].startswith("recorded with another bundle: standing.onnx 000000000000,")
    assert found.remarks[1].startswith("recorded with cpu Abacus, this is ")
    assert "round differently" in found.remarks[2]


def test_an_empty_log_is_refused(about, standing, tmp_path):
    with pytest.raises(InputError, match=r"empty\.mcap: no tick in it"):
        through(write(tmp_path / "empty.mcap", about, []), standing)


def test_a_walk_over_can_replays_too(standing, tmp_path):
    bundle = load_bundle(standing)
    settings = msgspec.structs.replace(BRISK, link=LinkSettings(kind="can"))
    emulator = Emulator(wire=CanRobot(settings.can, A1))
    log = tmp_path / "log.mcap"
    operator = FlagOperator(bundle.table.commands, seconds=0.5)
    with log_file(log, describe(bundle, settings, real_time=False)) as file:
        outcome = lockstep.walk(emulator, bundle, operator, lambda _: None, file.add, settings)
    assert outcome.report.policy_steps > 20
    found = through(FlightLog(log), standing)
    assert found.identical, found.first


def test_a_minute_of_trotting_replays_to_the_byte(tmp_path):
    bundle = load_bundle(TROT)
    log = tmp_path / "log.mcap"
    operator = FlagOperator(bundle.table.commands, 0.5, 0.1, 8.0, seconds=60.0)
    with log_file(log, describe(bundle, RuntimeSettings(), real_time=False)) as file:
        outcome = lockstep.walk(Emulator(), bundle, operator, lambda _: None, file.add)
    assert outcome.report.policy_steps >= 3000
    found = replay(FlightLog(log), bundle, lambda _: None)
    assert found.ticks > 12_000
    assert found.identical, found.first


@contextmanager
def start(module: str, *flags: object) -> Iterator[subprocess.Popen[str]]:
    words = [sys.executable, "-m", module, *map(str, flags)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for_log(path: Path, wanted) -> FlightLog:
    """The log, once it is as wanted."""
    deadline = time.monotonic() + 100
    while time.monotonic() < deadline:
        with suppress(InputError):  # it has not begun
            log = FlightLog(path)
            if wanted(log, sum(1 for _ in log.ticks())):
                return log
        time.sleep(0.1)
    raise AssertionError(f"{path} does not get there")


def test_the_log_of_a_daemon_that_was_killed_is_whole_and_replays(standing, tmp_path):
    """In real time, over UDP; whatever the machine made of it."""
    path, settings = tmp_path / "walk.mcap", tmp_path / "patient.yaml"
    patient = {"stale_ms": 1000, "frozen_ms": 1000, "missed_ticks": 400}
    settings.write_text(yaml.safe_dump({"link": {"startup_timeout": 60}, "safety": patient}))
    with start("rmll_hil.cli", "serve", "--port", 0, "--reply", "echo") as robot:
        assert robot.stdout
        address = robot.stdout.readline().split()[-1]
        flags = ("--policy", standing, "--vx", 0, "--settings", settings, "--record", path)
        with start("rmll_onboard.cli", *flags, "--robot-address", address) as daemon:
            wait_for_log(path, lambda log, ticks: ticks > 100)
            daemon.kill()
    log = wait_for_log(path, lambda log, ticks: log.complete)
    assert log.about.arguments[:2] == ["--policy", str(standing)]
    found = through(log, standing)
    assert found.identical, found.first
    assert found.ticks > 100


def command(*flags: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "rmll_hil.cli", "replay", *map(str, flags)]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True)


def test_the_command_says_what_differs(walked, about, standing, tmp_path):
    odd = msgspec.structs.replace(walked[99], answer=bytes(610))
    write(tmp_path / "log.mcap", about, [*walked[:99], odd, *walked[100:]])
    done = command("log.mcap", "--policy", standing, cwd=tmp_path)
    assert done.returncode == 1
    assert "first difference: tick 99" in done.stdout
    total = f"1 of {len(walked)} datagrams differ, first at tick 99"
    assert done.stderr.endswith(f"\nrmll-hil: {total}\n")
    done = command("log.mcap", "--policy", standing, "--json", cwd=tmp_path)
    found = json.loads(done.stdout)
    assert (done.returncode, found["identical"], found["different"]) == (1, False, 1)
    done = command("log.mcap", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("rmll-hil: policies/trot.onnx: no such bundle; name the one")


def test_the_shipped_bundle_stands_in_for_no_other(walked, about, tmp_path):
    log = write(tmp_path / "log.mcap", about, walked[:5])
    complaint = (
        rf"log\.mcap: recorded with standing\.onnx {about.digest[:12]}, but .*trot\.onnx is "
        r"[0-9a-f]{12}, of the same rules; name the one to replay with by --policy"
    )
    with pytest.raises(InputError, match=complaint):
        find_bundle(log, TROT.parent)
    shipped = load_bundle(TROT)
    as_shipped = msgspec.structs.replace(about, digest=shipped.contract.digest)
    log = write(tmp_path / "shipped.mcap", as_shipped, walked[:5])
    assert find_bundle(log, TROT.parent) == TROT
