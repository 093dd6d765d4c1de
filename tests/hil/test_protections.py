"""A bad network and hostile datagrams, through the daemon's own code, in lockstep.

Each protection by itself: ``test_fault_table.py``.
"""

import socket
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rmll_hil.faults.fault_trial import MOTION
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.fault_plan import parse_plan
from rmll_hil.runs import lockstep, metrics
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.interface.transport import UdpTransport
from rmll_onboard.protocol import a1_packets
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.settings import runtime_settings as onboard
from rmll_onboard.settings.runtime_settings import Motion
from rmll_robots import A1

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


@pytest.fixture(scope="module")
def trot() -> Bundle:
    return load_bundle(TROT)


def steady(
    bundle: Bundle, seconds: float, seed: int = 0, **network: float
) -> dict[str, float | str | None]:
    """The figures of a trot over a bad network."""
    plan = parse_plan([{"fault": "network", **network}], A1)
    operator = FlagOperator(bundle.table.commands, 0.5, seconds=seconds)
    emulator = Emulator(EmulatorSettings(seed=seed), plan=plan)
    outcome = lockstep.walk(emulator, bundle, operator, lambda _: None)
    return metrics.summary(outcome, "trot", A1)


def test_a_minute_over_a_bad_network(trot: Bundle) -> None:
    figures = steady(trot, 60, loss=0.01, jitter_ms=5, duplicates=0.01, reorder=0.01)
    assert (figures.fault, figures.falls) == (None, 0)
    assert figures.seconds == 60
    assert figures.adherence >= 0.9
    assert figures.packets.lost > 100


@pytest.mark.parametrize("seed", range(3))
def test_with_a_fifth_lost_it_walks_or_damps(trot: Bundle, seed: int) -> None:
    figures = steady(trot, 10, seed, loss=0.2, jitter_ms=5, duplicates=0.05, reorder=0.05)
    if figures.fault is None:
        assert figures.falls == 0
        assert figures.adherence >= 0.8
    else:
        assert "no state" in figures.fault


class Hostile:
    """Makes datagrams that must not be believed."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._heard: list[bytes] = []

    def datagrams(self, good: bytes, count: int) -> list[bytes]:
        makers: list[Callable[[bytes], bytes]] = [
            self._random, self._truncated, self._flipped, self._replayed, self._tomorrow
        ]  # fmt: skip
        self._heard.append(good)
        choices = self._rng.integers(len(makers), size=count)
        return [makers[choice](good) for choice in choices]

    def _random(self, good: bytes) -> bytes:
        size = self._rng.choice([0, 1, len(good), 1400])
        return self._rng.bytes(int(size))

    def _truncated(self, good: bytes) -> bytes:
        return good[: self._rng.integers(len(good))]

    def _flipped(self, good: bytes) -> bytes:
        bit = int(self._rng.integers(8 * 764))  # the rest is not under the checksum
        bits = int.from_bytes(good, "little") ^ 1 << bit
        return bits.to_bytes(len(good), "little")

    def _replayed(self, good: bytes) -> bytes:
        return self._heard[self._rng.integers(len(self._heard))]

    def _tomorrow(self, good: bytes) -> bytes:
        """A whole state of another day."""
        state = a1_packets.decode_state(good)
        state.tick = int(self._rng.integers(state.tick + 5000, 2**32))
        state.q[:] = 0
        return A1BoardPackets().encode_state(state)


@pytest.mark.fuzz
def test_a_hundred_thousand_hostile_datagrams(trot: Bundle) -> None:
    """Real sockets, so that those of a stranger are among them; time in lockstep."""
    rng = np.random.default_rng(0)
    hostile, sent = Hostile(rng), 0
    operator = FlagOperator(trot.table.commands, 0.5, seconds=12)
    daemon = Daemon(trot, onboard.RuntimeSettings(motion=Motion(**MOTION)), operator)
    emulator = Emulator()
    board, stranger = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with board, stranger:
        board.bind(("127.0.0.1", 0))
        link = UdpTransport("127.0.0.1:{}".format(*board.getsockname()[1:]))
        link.send(b"hello")
        _, daemon_address = board.recvfrom(100)
        ticks = []
        while not daemon.finished:
            now = emulator.now_ms * 1_000_000
            emulator.receive(daemon.tick(now, link.receive()))
            ticks.append(daemon.interface.state.tick)
            emulator.advance(5, now)
            good = emulator.state_datagram()
            # whoever speaks first is believed; from then on they are many
            batch = hostile.datagrams(good, 40 if len(ticks) > 10 else 0)
            place = rng.integers(len(batch) + 1)
            for datagram in (*batch[:place], good, *batch[place:]):
                board.sendto(datagram, daemon_address)
            stranger.sendto(bytes(len(good)), daemon_address)
            stranger.sendto(good, daemon_address)
            sent += len(batch) + 2
        link.close()
    assert sent > 100_000
    assert (daemon.fault, daemon.report().warnings) == (None, ())
    assert daemon.report().adherence > 0.9
    assert not emulator.truth()["grounded"][400:-400].any()
    # one good state a tick, and nothing else was believed
    assert daemon.interface.received == len(ticks) - 1
    assert all(b - a == 5 for a, b in pairwise(ticks[1:]))
    # a state twice, or an old one, is not even looked at beside a good one
    assert daemon.interface.refused.total() > 10_000
