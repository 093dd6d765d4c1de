"""The tick from datagram in to datagram out, stage by stage, beside the least that it can take.

The floor is what no runtime can do without: receive 771 bytes, run the same network, send 610
bytes, on the same machine in the same run. Back to back all caches are warm; at the real pace, a
policy tick every 20 ms, they are not, and what counts is the ratio there.
"""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnxruntime
import pytest
import yaml
from onnxruntime import OrtValue

from rmll_common.errors import Failure
from rmll_contract import observation
from rmll_onboard.control.bundle import Bundle
from rmll_onboard.interface.transport import UdpTransport
from rmll_onboard.protocol.a1_packets import LOW_CMD_LENGTH, decode_state, encode_command
from rmll_onboard.runtime import realtime
from rmll_onboard.runtime.cache_warmup import CacheWarmer
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.loop import Loop
from rmll_onboard.safety.sensor_monitor import SensorMonitor
from rmll_onboard.settings.runtime_settings import Realtime, RuntimeSettings
from rmll_onboard.state.robot_state import MotorCommand, Streams

ROUNDS = 2000
FLOOR_SECONDS, WALK_SECONDS = 6.0, 15.0
POLICY_PERIOD = 20_000_000
"""[ns]"""
PACES = {
    "asleep between ticks": Realtime(early_us=0, cache_warmup_us=0),
    "awake early": Realtime(cache_warmup_us=0),
    "awake early, rehearsed": Realtime(),
    "and first in line": Realtime(priority=50),
}


class Bare:
    """Receive, run the network, send; with nothing in between."""

    def __init__(self, session: onnxruntime.InferenceSession, robot: tuple[str, int]) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(robot)
        self.command = encode_command(MotorCommand())
        assert len(self.command) == LOW_CMD_LENGTH
        self._session = session
        self._binding = session.io_binding()
        for value in session.get_inputs():
            zeros = OrtValue.ortvalue_from_numpy(np.zeros(value.shape, np.float32))
            self._binding.bind_ortvalue_input(value.name, zeros)
        for value in session.get_outputs():
            room = OrtValue.ortvalue_from_shape_and_type(value.shape, np.float32)
            self._binding.bind_ortvalue_output(value.name, room)

    def __call__(self) -> None:
        self.socket.recv(2048)
        self._session.run_with_iobinding(self._binding)
        self.socket.send(self.command)

    def paced(self, seconds: float) -> list[float]:
        """[us] of each tick, one every 20 ms, at a robot that answers commands."""
        self.socket.settimeout(1.0)
        self.socket.send(self.command)
        durations = []
        deadline = time.monotonic_ns()
        for _ in range(int(seconds * 1e9) // POLICY_PERIOD):
            deadline += POLICY_PERIOD
            time.sleep(max(0, deadline - time.monotonic_ns()) / 1e9)
            began = time.monotonic_ns()
            self()
            durations.append((time.monotonic_ns() - began) / 1000)
        return durations


@contextmanager
def in_line(priority: int) -> Iterator[None]:
    """Scheduled as a daemon with this ``realtime.priority``."""
    try:
        if priority:
            realtime.enter(Realtime(priority=priority))
        yield
    except Failure as refused:
        pytest.skip(str(refused))
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def timed(call: Callable[[], Any], before: Callable[[], Any]) -> list[float]:
    """[us] of each call, back to back but for what has to be done before."""
    durations = []
    for _ in range(ROUNDS):
        before()
        began = time.perf_counter_ns()
        call()
        durations.append((time.perf_counter_ns() - began) / 1000)
    return durations


class Replayed:
    """A daemon that is sent a recorded walk over UDP, a tick a call."""

    def __init__(
        self, daemon: Daemon, walk: list, robot: socket.socket, link: UdpTransport
    ) -> None:
        self.daemon, self._robot, self.link = daemon, robot, link
        self._ticks: Iterator = iter(walk)
        self._now = 0

    def send_state(self) -> None:
        """What the robot sends before the next tick."""
        tick = next(self._ticks)
        self._now = tick.now
        for datagram in tick.datagrams:
            self._robot.send(datagram)

    def tick(self) -> None:
        self.link.send(self.daemon.tick(self._now, self.link.receive()))

    def up_to(self, policy: bool) -> None:
        """Go on until the next tick is one of the policy's, or is not, and send its state."""
        self.send_state()
        while self.daemon.policy_next is not policy:
            self.tick()
            self.send_state()


@pytest.fixture
def replayed(bundle: Bundle, walk, new_operator, wire) -> Replayed:
    """In the midst of walking."""
    daemon = Daemon(bundle, RuntimeSettings(), new_operator())
    replayed = Replayed(daemon, walk, *wire)
    while not daemon.policy_ran:
        replayed.send_state()
        replayed.tick()
    return replayed


@pytest.mark.parametrize("policy", [True, False], ids=["policy", "plain"])
def test_tick_back_to_back(benchmark, tell, replayed: Replayed, bundle, policy: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        bare = Bare(bundle.session, other.getsockname())
        with closing(bare.socket):
            state, ours = bytes(771), bare.socket.getsockname()
            floor = timed(bare, lambda: other.sendto(state, ours))
    rounds = 900 if policy else ROUNDS
    benchmark.pedantic(replayed.tick, setup=lambda: replayed.up_to(policy), rounds=rounds)
    tick = tell(f"{'policy' if policy else 'plain'} tick, back to back", durations(benchmark))
    if policy:
        ratio = tick / tell("floor, back to back", floor)
        benchmark.extra_info["ratio"] = round(ratio, 2)
        print(f"\nratio {ratio:.2f}", end="")


def durations(benchmark) -> list[float]:
    return [seconds * 1e6 for seconds in benchmark.stats.stats.data]


class Stopwatch:
    """Adds up what each stage takes of a policy tick."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []
        self._row: dict[str, float] = {}

    def watch(self, monkeypatch: pytest.MonkeyPatch, stage: str, owner: Any, name: str) -> None:
        inner = getattr(owner, name)

        def timed(*arguments: Any, **named: Any) -> Any:
            began = time.perf_counter_ns()
            result = inner(*arguments, **named)
            took = (time.perf_counter_ns() - began) / 1000
            self._row[stage] = self._row.get(stage, 0.0) + took
            return result

        monkeypatch.setattr(owner, name, timed)

    def lap(self, daemon: Daemon) -> None:
        """A tick is over."""
        if self._row and daemon.policy_ran:
            self.rows.append(self._row)
        self._row = {}


def watch_stages(
    watch: Stopwatch, monkeypatch: pytest.MonkeyPatch, daemon: Daemon, link: UdpTransport
) -> None:
    """No stage is within another one; what belongs to none is told as the rest."""
    controller, guard, supervisor = daemon.controller, daemon._guard, daemon._supervisor
    stages = {
        "receive": [(link, "receive")],
        "decode": [(daemon.interface, "take")],
        "guard, supervisor": [
            *((guard, "complaint"), (guard.actuators, "sent"), (daemon._action_guard, "complaint")),
            *((supervisor, "update"), (supervisor, "command"), (daemon, "_orders")),
        ],
        "labels, automaton": [(daemon.feet, "step"), (controller._progress, "step")],
        "observation": [(observation, "write")],
        "inference": [(controller._policy, "run")],
        "encode": [(daemon, "_encode")],
        "whole tick": [(daemon, "tick")],
        "send": [(link, "send")],
    }
    for stage, places in stages.items():
        for owner, name in places:
            watch.watch(monkeypatch, stage, owner, name)


def tell_stages(tell, rows: list[dict[str, float]]) -> None:
    inside = set(rows[0]) - {"receive", "send", "whole tick"}
    for row in rows:
        whole = row.pop("whole tick")
        row["rest"] = whole - sum(row[stage] for stage in inside)
        row["in all"] = whole + row["receive"] + row["send"]
    for stage in rows[0]:
        tell(stage, [row[stage] for row in rows])


def test_stages_back_to_back(benchmark, tell, replayed: Replayed, monkeypatch) -> None:
    watch, daemon = Stopwatch(), replayed.daemon
    watch_stages(watch, monkeypatch, daemon, replayed.link)

    def prepare() -> None:
        watch.lap(daemon)  # the policy tick before
        replayed.up_to(policy=True)
        watch.lap(daemon)  # and the plain ones since

    benchmark.pedantic(replayed.tick, setup=prepare, rounds=900)
    watch.lap(daemon)
    tell_stages(tell, watch.rows)


@pytest.mark.parametrize("pace", [name for name, pace in PACES.items() if not pace.priority])
def test_stages_at_the_real_pace(
    benchmark, tell, monkeypatch, emulated, bundle: Bundle, new_operator, pace: str
) -> None:
    """In this process; beside :func:`test_tick_at_the_real_pace` it pays for the stopwatch."""
    watch = Stopwatch()
    daemon = Daemon(bundle, RuntimeSettings(), new_operator())
    with emulated() as address, closing(UdpTransport(address)) as link:
        watch_stages(watch, monkeypatch, daemon, link)
        cache_warmer = CacheWarmer(bundle, RuntimeSettings())
        loop = Loop(daemon, link, PACES[pace], lambda tick: watch.lap(daemon), None, cache_warmer)
        benchmark.pedantic(loop.run, args=(5.0,), rounds=1)
    assert daemon.fault is None
    print(f"\n{pace}:", end="")
    tell_stages(tell, watch.rows)


@pytest.mark.parametrize("pace", PACES)
def test_tick_at_the_real_pace(
    benchmark, tell, emulated, bundle: Bundle, trot: Path, tmp_path: Path, pace: str
) -> None:
    """``rmll-onboard`` as it is, on an emulated robot, between two measurements of the floor."""
    settings = tmp_path / "settings.yaml"
    settings.write_text(yaml.safe_dump({"realtime": msgspec.to_builtins(PACES[pace])}))
    command = [
        *(sys.executable, "-m", "rmll_onboard.cli", "--policy", trot, "--settings", settings),
        *("--vx", "0.5", "--seconds", str(WALK_SECONDS), "--json"),
    ]

    def floor() -> list[float]:
        with emulated() as address:
            host, port = address.rsplit(":", 1)
            bare = Bare(bundle.session, (host, int(port)))
            with closing(bare.socket), in_line(PACES[pace].priority):
                return bare.paced(FLOOR_SECONDS)

    def walk() -> dict[str, Any]:
        with emulated() as address:
            walked = subprocess.run(
                [*command, "--robot-address", address], capture_output=True, text=True
            )
        assert walked.returncode == 0, walked.stderr
        return json.loads(walked.stdout)

    before = floor()
    report = benchmark.pedantic(walk, rounds=1)
    least = tell("floor, paced", before + floor())
    ratio = report["tick_us"]["p50"] / least
    figures = {"tick": report["tick_us"], "plain tick": report["timekeeping"]["plain_tick_us"]}
    figures |= {"wake-up": report["wake_us"], "slack": report["timekeeping"]["slack_us"]}
    memory = {"rss_mb": report["rss_mb"], "memory_mb": report["timekeeping"]["memory_mb"]}
    benchmark.extra_info |= {"pace": pace, "ratio": round(ratio, 2)} | figures | memory
    for name, values in figures.items():
        told = "   ".join(f"{key} {value:.0f}" for key, value in values.items())
        print(f"\n{pace}: {name:12} {told} us", end="")
    print(f"\n{pace}: ratio {ratio:.2f}, resident memory {report['rss_mb']} MB", end="")


def test_sensor_checks(benchmark, tell, bundle: Bundle, walk) -> None:
    """What a packet's sensors cost: all of it, as in a tick; at most 15 us at p50."""
    safety = RuntimeSettings().safety
    monitor = SensorMonitor(bundle.robot, safety, Streams(True, True, True), 1e-3)
    states = [(tick.now, decode_state(tick.datagrams[-1])) for tick in walk if tick.datagrams]
    took = []
    for now, state in states:
        began = time.perf_counter_ns()
        monitor.measure(now, state, True, True)
        told = monitor.fault, monitor.doubt, monitor.joints.still(safety.joint_still_ms)
        took.append((time.perf_counter_ns() - began) / 1000)
        assert told[0] is None
    tell("sensor checks of a packet", took)
    benchmark.pedantic(monitor.measure, args=(*states[-1], True, True), rounds=1)
