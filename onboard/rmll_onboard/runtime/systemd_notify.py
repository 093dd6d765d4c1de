"""Telling the service manager, systemd, that we are ready, alive and about to end.

The protocol of sd_notify(3) and sd_watchdog_enabled(3): a datagram of text to the UNIX socket that
the environment names. Without such a socket nobody wants to know, and nothing is sent.
"""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress


class SystemdNotifier:
    """Never waits and never raises."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # a leading @ stands for the zero byte of Linux's abstract names
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
        self._interval = _watchdog_ns(environment) // 2
        self._next = 0
        self._is_ready = False

    def ready(self) -> None:
        """The robot has answered; only the first time is told."""
        if not self._is_ready:
            self._is_ready = True
            self._tell("READY=1")

    def alive(self, now: int) -> None:
        """To be called more often than the watchdog asks for; ``now`` [ns], monotonic."""
        if self._interval and now >= self._next:
            self._next = now + self._interval
            self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        self._tell("STOPPING=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def _tell(self, text: str) -> None:
        if self._socket is not None:
            with suppress(OSError):
                self._socket.sendto(text.encode(), self._address)


def _watchdog_ns(environment: Mapping[str, str]) -> int:
    """How long we may be silent, 0 for ever."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return 0  # it is another process that is watched
    text = environment.get("WATCHDOG_USEC", "")
    return int(text) * 1000 if text.isascii() and text.isdigit() else 0
