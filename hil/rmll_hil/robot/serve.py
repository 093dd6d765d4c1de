"""The emulator as a process of its own, in real time, on a UDP socket."""

import json
import select
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from rmll_common.errors import Failure, InputError
from rmll_hil.robot.emulator import Emulator

Address = tuple[str, int]
Reply = Literal["stream", "echo"]
"""When the board sends its state, from the first command on: at 500 Hz, or only in those
periods of 500 Hz in which a command came. Which of the two the A1 does is not published."""

PERIOD_MS = 2
PERIOD_NS = PERIOD_MS * 1_000_000
LARGEST_LAG_NS = 100_000_000
"""Lateness up to which missed time is caught up; beyond it the robot's time stood still"""
LARGEST_DATAGRAM = 2048


class Ending(Protocol):
    """Looked at in every period."""

    @property
    def wanted(self) -> bool: ...


class Stop:
    """A wish to end."""

    def __init__(self) -> None:
        self.wanted = False

    @contextmanager
    def on_signals(self) -> Iterator["Stop"]:
        """Set by SIGTERM and SIGINT inside; yields itself."""
        before = {n: signal.signal(n, self._set) for n in (signal.SIGTERM, signal.SIGINT)}
        try:
            yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _set(self, *_: object) -> None:
        self.wanted = True


def listen(host: str, port: int) -> socket.socket:
    """A UDP socket bound to an address; port 0 takes a free one.

    Raises InputError for a port that is none, Failure for an address that cannot be had.
    """
    if not 0 <= port <= 65535:
        raise InputError(f"--port {port}: expected 0 to 65535")
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.bind((host, port))
    except (OSError, TypeError) as error:  # the latter of a name that cannot be encoded
        sock.close()
        why = error.strerror if isinstance(error, OSError) else "no host name"
        raise Failure(f"cannot listen on {host}:{port}: {why}") from error
    return sock


def serve(
    emulator: Emulator,
    sock: socket.socket,
    reply: Reply,
    stop: Ending,
    largest_lag_ns: int = LARGEST_LAG_NS,
) -> float:
    """Run until ``stop``; returns the robot's time over the wall's, from the first command on.

    Nothing is sent and no time passes before a first command; states then go to whoever sent
    the last one.
    """
    peer = None
    started = deadline = time.monotonic_ns()
    while not stop.wanted:
        deadline += PERIOD_NS
        accepted = emulator.accepted
        peer = _commands(emulator, sock, deadline, peer is not None) or peer
        if peer is None:
            started = deadline
            continue
        if reply == "stream" or emulator.accepted > accepted:
            emulator.from_robot.send(emulator.state_datagram(), emulator.now_ms)
        for datagram, _ in emulator.from_robot.arrived(emulator.now_ms):
            with suppress(OSError):  # a network that is down: a loss
                sock.sendto(datagram, peer)
        emulator.advance(PERIOD_MS, deadline)
        if time.monotonic_ns() - deadline > largest_lag_ns:
            deadline = time.monotonic_ns()
    return emulator.now_ms * 1e6 / max(time.monotonic_ns() - started, 1)


def save(emulator: Emulator, path: Path, realtime_factor: float) -> None:
    """Write the truth and the counters of a run as .npz."""
    counters = {
        "received": emulator.received,
        "rejected": emulator.rejected,
        "sent": emulator.sent,
        "realtime_factor": realtime_factor,
    }
    np.savez_compressed(path, truth=emulator.truth(), counters=json.dumps(counters))


def _commands(
    emulator: Emulator, sock: socket.socket, deadline_ns: int, running: bool
) -> Address | None:
    """Feed datagrams until the deadline; returns the sender of the last good one.

    ``running``: the robot's time passes. Without it the network would hold a datagram forever.
    """
    peer = None
    while True:
        left = deadline_ns - time.monotonic_ns()
        came = select.select([sock], [], [], max(left, 0) * 1e-9)[0]
        if came:
            datagram, sender = sock.recvfrom(LARGEST_DATAGRAM)
            if running:
                emulator.to_robot.send(datagram, emulator.now_ms, sender)
            elif emulator.receive(datagram):
                peer = sender
        for datagram, sender in emulator.to_robot.arrived(emulator.now_ms):
            peer = sender if emulator.receive(datagram) else peer
        if left <= 0 or not came:
            return peer
