"""The loop around a daemon, in real time, with a robot that lives in the same process."""

import dataclasses
import gc
import socket
from contextlib import closing, suppress

import msgspec
import numpy as np
import pytest

from rmll_gaits.table import Commands
from rmll_onboard import a1_wire
from rmll_onboard.daemon import Daemon
from rmll_onboard.loop import Loop
from rmll_onboard.pilot import FlagPilot
from rmll_onboard.service import Service
from rmll_onboard.settings import Realtime, Safety
from rmll_onboard.understudy import Understudy


class InProcess:
    """A link that ends in a robot without physics, and keeps a diary."""

    name = "a robot in this process"

    def __init__(self, robot, diary):
        self._robot, self._diary = robot, diary
        self._waiting = []

    def send(self, datagram):
        self._diary.append("send")
        self._waiting = [self._robot.answer(datagram)]

    def receive(self):
        self._diary.append("receive")
        datagrams, self._waiting = self._waiting, []
        return datagrams

    def close(self):
        pass


@pytest.fixture
def patient(brisk):
    """A machine with other work to do is late, which is no fault here."""
    safety = Safety(missed_ticks=400, stale_ms=1000, frozen_ms=5000)
    return msgspec.structs.replace(brisk, safety=safety)


@pytest.fixture
def daemon(bundle, patient):
    return Daemon(bundle, patient, FlagPilot(bundle.table.commands, vx=0.5, seconds=0.3))


@pytest.mark.parametrize("pace", [Realtime(), Realtime(early_us=0, rehearse_us=0)], ids=str)
def test_between_state_and_command_there_is_nothing_else(bundle, patient, daemon, robot, pace):
    diary = []
    understudy = Understudy(bundle, patient)
    link = InProcess(robot, diary)
    loop = Loop(daemon, link, pace, lambda tick: diary.append("keep"), understudy=understudy)
    loop.run(5.0)
    while diary[-1] == "send":  # the farewell
        diary.pop()
    # before a rehearsal it looks what came, too
    ticks = "".join(word[0] for word in diary).replace("rr", "r")
    assert len(ticks) > 30
    assert ticks == "rsk" * (len(ticks) // 3)
    report = loop.report()
    assert daemon.report()["policy_steps"] > 0
    assert (understudy.report()["policy_steps"] > 0) == (pace.rehearse_us > 0)
    assert report["tick_us"]["p50"] > 0
    assert report["wake_us"]["p50"] >= 0
    kept = report["timekeeping"]
    assert kept["slack_us"]["p50"] < daemon.period / 1000
    assert len(kept["memory_mb"]) >= 2
    assert robot.damped


def test_nobody_collects_garbage_meanwhile_and_then_again(daemon, robot):
    seen = set()
    loop = Loop(
        daemon, InProcess(robot, []), Realtime(), keep=lambda tick: seen.add(gc.isenabled())
    )
    loop.run(5.0)
    assert seen == {False}
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_a_service_manager_is_kept_informed(daemon, robot, tmp_path):
    words = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)

        def listen(_=None):
            with suppress(BlockingIOError):
                while True:
                    words.append(manager.recv(100).decode())

        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "100000"}
        with closing(Service(environment)) as service:
            Loop(daemon, InProcess(robot, []), Realtime(), listen, service).run(5.0)
        listen()
    assert (words.count("READY=1"), words[-1]) == (1, "STOPPING=1")
    assert words.count("WATCHDOG=1") >= 3


def lockstep(daemon, robot, understudy=None):
    """A walk with its own clock; returns what was sent."""
    now, sent, datagrams = 0, [], []
    while not daemon.finished:
        now += daemon.period
        if understudy is not None and daemon.policy_next:
            understudy.rehearse(now - 1_000_000, datagrams)
        sent.append(daemon.tick(now, datagrams))
        datagrams = [robot.answer(sent[-1])]
    return sent


def test_a_rehearsal_goes_through_policy_ticks_and_changes_no_command(bundle, patient, robot):
    walks = []
    for understudy in (None, Understudy(bundle, patient)):
        robot.__init__()
        pilot = FlagPilot(bundle.table.commands, vx=0.5, seconds=2.0)
        daemon = Daemon(bundle, patient, pilot)
        walks.append(lockstep(daemon, robot, understudy))
    assert len(walks[0]) > 400
    assert walks[0] == walks[1]
    assert understudy.fault is None
    # all but the first one of the walk, and those of its way out
    assert understudy.report()["policy_steps"] >= daemon.report()["policy_steps"] - 1 > 90


def test_an_understudy_of_a_gait_that_only_walks_forwards(bundle, patient):
    forwards = Commands(vx=(0.3, 1.0), wz=(0.1, 0.2), frequency=(6.2, 6.4))
    table = dataclasses.replace(bundle.table, commands=forwards)
    Understudy(dataclasses.replace(bundle, table=table), patient).rehearse(0, [])


def test_an_understudy_plays_on_after_a_fault(bundle, patient, robot):
    understudy = Understudy(bundle, patient)
    for count, quaternion in enumerate(([0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])):
        robot.state.quaternion[:] = quaternion
        state = robot.answer(understudy.damping())
        understudy.rehearse(20_000_000 * (count + 1), [state])
        assert understudy.policy_ran == (understudy.fault is None) == (count > 0)


def test_policy_ticks_are_foreseen(bundle, patient, robot):
    daemon = Daemon(bundle, patient, FlagPilot(bundle.table.commands, vx=0.5, seconds=0.5))
    now, datagrams, foreseen, ran = 0, [], [], []
    while not daemon.finished:
        now += daemon.period
        foreseen.append(daemon.policy_next)
        datagrams = [robot.answer(daemon.tick(now, datagrams))]
        ran.append(daemon.policy_ran)
    first = ran.index(True)
    walked = slice(first + 1, first + 101)
    assert foreseen[walked] == ran[walked]
    assert sum(foreseen[walked]) == 25


def test_ticks_leave_nothing_for_the_garbage_collector(bundle, patient, robot):
    daemon = Daemon(bundle, patient, FlagPilot(bundle.table.commands, vx=0.5))
    understudy = Understudy(bundle, patient)
    states = np.random.default_rng(0)
    now, datagrams = 0, []
    while not daemon.policy_ran:
        now += daemon.period
        datagrams = [robot.answer(daemon.tick(now, datagrams))]
    gc.collect()
    gc.disable()
    try:
        for count in range(80):
            now += daemon.period
            understudy.rehearse(now, datagrams)
            answer = robot.answer(daemon.tick(now, datagrams))
            broken = states.bytes(a1_wire.LOW_STATE_LENGTH)
            datagrams = [[answer], [broken], [answer, broken, answer], []][count % 4]
        assert daemon.fault is None
        assert gc.collect() == 0
    finally:
        gc.enable()
