"""The loop around a daemon, in virtual time, with a robot that lives in the same process."""

import dataclasses
import gc
import signal
import socket
from contextlib import closing, suppress
from itertools import pairwise

import msgspec
import numpy as np
import pytest

from rmll_gaits.table import Commands
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.protocol import a1_packets
from rmll_onboard.runtime.cache_warmup import CacheWarmer, cache_warmer
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.loop import Loop
from rmll_onboard.runtime.systemd_notify import SystemdNotifier
from rmll_onboard.settings.runtime_settings import Realtime
from rmll_onboard.state.modes import Mode
from rmll_robots import A1


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
def daemon(bundle, brisk):
    return Daemon(bundle, brisk, FlagOperator(bundle.table.commands, vx=0.5, seconds=0.3))


def test_a_cache_warmer_that_fails_is_off_and_told(bundle, brisk, daemon, robot, clock):
    class Broken(CacheWarmer):
        calls = 0

        def warm_up(self, now, datagrams):
            self.calls += 1
            raise ZeroDivisionError("so it goes")

    warmer = Broken(bundle, brisk)
    Loop(daemon, InProcess(robot, []), Realtime(), cache_warmer=warmer, clock=clock).run(5.0)
    assert warmer.calls == 1
    report = daemon.report()
    assert report.warnings == ("the cache warmer is off: ZeroDivisionError('so it goes')",)
    assert report.fault is None
    assert report.policy_steps > 10


@pytest.mark.parametrize("pace", [Realtime(), Realtime(early_us=0, cache_warmup_us=0)], ids=str)
def test_between_state_and_command_there_is_nothing_else(bundle, brisk, daemon, robot, clock, pace):
    diary = []
    warmer = cache_warmer(bundle, msgspec.structs.replace(brisk, realtime=pace))
    link = InProcess(robot, diary)
    loop = Loop(daemon, link, pace, lambda _: diary.append("keep"), None, warmer, clock)
    loop.run(5.0)
    while diary[-1] == "send":  # the farewell
        diary.pop()
    # before a warm-up it looks what came, too
    ticks = "".join(word[0] for word in diary).replace("rr", "r")
    assert len(ticks) > 30
    assert ticks == "rsk" * (len(ticks) // 3)
    report = loop.report()
    assert daemon.report().policy_steps > 0
    assert (warmer is None) == (pace.cache_warmup_us == 0)
    assert warmer is None or warmer.report().policy_steps > 0
    # each look at the clock takes 10 us of virtual time
    assert (report.tick_us.p50, report.tick_us.max) == (10, 10)
    assert 0 <= report.wake_us.max <= 30
    kept = report.timekeeping
    assert kept.missed == 0
    assert daemon.period / 1000 - 50 < kept.slack_us.min < daemon.period / 1000
    assert len(kept.memory_mb) >= 2
    assert robot.damped


def test_after_a_stall_it_goes_on_with_the_next_deadline(daemon, robot, clock):
    moments = []

    def stall(tick):
        moments.append(tick.now)
        if len(moments) == 30:
            clock.sleep(0.0265)

    loop = Loop(daemon, InProcess(robot, []), Realtime(), stall, clock=clock)
    loop.run(5.0)
    steps = [round((b - a) / daemon.period, 1) for a, b in pairwise(moments)]
    # late at once, then the grid again, and nothing is hurried to catch up
    assert steps[28:32] == [1.0, 5.3, 0.7, 1.0]
    assert loop.report().timekeeping.missed == 4


def send_signals(*numbers):
    """Something to keep ticks: sends this process signals, one each at the ticks from 200 on."""
    pending = list(numbers)

    def keep(tick):
        if tick.number >= 200 and pending:
            signal.raise_signal(pending.pop(0))

    return keep


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_sits_it_down(bundle, brisk, robot, clock, number):
    daemon = Daemon(bundle, brisk, FlagOperator(bundle.table.commands, vx=0.5))
    before = signal.getsignal(number)
    keep = send_signals(number)
    loop = Loop(daemon, InProcess(robot, []), Realtime(), keep, clock=clock)
    loop.run(5.0)
    assert (loop.stopped_by, daemon.fault, daemon.mode) == (number, None, Mode.DAMPING)
    # on the spot and down, a tenth of a second each, and half a second of damping
    assert 1.6e9 < clock.now < 2.3e9
    assert np.abs(robot.state.q - A1.crouch_pose).max() < 0.03
    assert signal.getsignal(number) is before


def test_a_second_signal_damps_at_once(bundle, brisk, robot, clock):
    daemon = Daemon(bundle, brisk, FlagOperator(bundle.table.commands, vx=0.5))
    keep = send_signals(signal.SIGINT, signal.SIGTERM)
    loop = Loop(daemon, InProcess(robot, []), Realtime(), keep, clock=clock)
    loop.run(5.0)
    assert (loop.stopped_by, daemon.mode) == (signal.SIGINT, Mode.WALKING)
    assert loop.report().packets.sent == 202 + 100
    assert robot.damped


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_ends_in_damping_too(daemon, robot, clock, error):
    def fail(tick):
        if tick.number == 80:
            raise error

    with pytest.raises(error):
        Loop(daemon, InProcess(robot, []), Realtime(), fail, clock=clock).run(5.0)
    assert daemon.mode is not Mode.DAMPING
    assert robot.damped


def test_nobody_collects_garbage_meanwhile_and_then_again(daemon, robot, clock):
    seen = set()
    keep = lambda tick: seen.add(gc.isenabled())  # noqa: E731
    loop = Loop(daemon, InProcess(robot, []), Realtime(), keep, clock=clock)
    loop.run(5.0)
    assert seen == {False}
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_a_service_manager_is_kept_informed(daemon, robot, clock, tmp_path):
    words = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)

        def listen(_=None):
            with suppress(BlockingIOError):
                while True:
                    words.append(manager.recv(100).decode())

        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "100000"}
        with closing(SystemdNotifier(environment)) as service:
            loop = Loop(daemon, InProcess(robot, []), Realtime(), listen, service, clock=clock)
            loop.run(5.0)
        listen()
    assert (words.count("READY=1"), words[-1]) == (1, "STOPPING=1")
    assert words.count("WATCHDOG=1") >= 3


def lockstep(daemon, robot, warmer=None):
    """A walk with its own clock; returns what was sent."""
    now, sent, datagrams = 0, [], []
    while not daemon.finished:
        now += daemon.period
        if warmer is not None and daemon.policy_next:
            warmer.warm_up(now - 1_000_000, datagrams)
        sent.append(daemon.tick(now, datagrams))
        datagrams = [robot.answer(sent[-1])]
    return sent


def test_a_warm_up_goes_through_policy_ticks_and_changes_no_command(bundle, brisk, robot):
    walks = []
    for warmer in (None, CacheWarmer(bundle, brisk)):
        robot.__init__()
        operator = FlagOperator(bundle.table.commands, vx=0.5, seconds=2.0)
        daemon = Daemon(bundle, brisk, operator)
        walks.append(lockstep(daemon, robot, warmer))
    assert len(walks[0]) > 400
    assert walks[0] == walks[1]
    assert warmer.fault is None
    # all but the first one of the walk, and those of its way out
    assert warmer.report().policy_steps >= daemon.report().policy_steps - 1 > 90


def test_a_cache_warmer_of_a_gait_that_only_walks_forwards(bundle, brisk):
    forwards = Commands(vx=(0.3, 1.0), wz=(0.1, 0.2), frequency=(6.2, 6.4))
    table = dataclasses.replace(bundle.table, commands=forwards)
    CacheWarmer(dataclasses.replace(bundle, table=table), brisk).warm_up(0, [])


def test_a_cache_warmer_plays_on_after_a_fault(bundle, brisk, robot):
    warmer = CacheWarmer(bundle, brisk)
    for count, quaternion in enumerate(([0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])):
        robot.answer(warmer.damping())
        robot.state.quaternion[:] = quaternion
        warmer.warm_up(20_000_000 * (count + 1), [A1BoardPackets().encode_state(robot.state)])
        assert warmer.policy_ran == (warmer.fault is None) == (count > 0)


def test_policy_ticks_are_foreseen(bundle, brisk, robot):
    daemon = Daemon(bundle, brisk, FlagOperator(bundle.table.commands, vx=0.5, seconds=0.5))
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


def test_ticks_leave_nothing_for_the_garbage_collector(bundle, brisk, robot):
    daemon = Daemon(bundle, brisk, FlagOperator(bundle.table.commands, vx=0.5))
    warmer = CacheWarmer(bundle, brisk)
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
            warmer.warm_up(now, datagrams)
            answer = robot.answer(daemon.tick(now, datagrams))
            broken = states.bytes(a1_packets.LOW_STATE_LENGTH)
            datagrams = [[answer], [broken], [answer, broken, answer], []][count % 4]
        assert daemon.fault is None
        assert gc.collect() == 0
    finally:
        gc.enable()
