"""The wire to the robot's low-level board."""

import errno
import socket
from contextlib import suppress
from typing import Protocol

from rmll_common.errors import Failure, InputError

# A flood must not hold the loop: at most so many datagrams are read in one go
_DRAIN = 64
_LONGEST = 2048


class Transport(Protocol):
    """Datagrams to and from a robot; neither call blocks."""

    name: str
    """Who is at the other end, for messages"""

    def send(self, datagram: bytes) -> None:
        """Send one datagram; a loss shows in the answers that do not come."""
        ...

    def receive(self) -> list[bytes]:
        """What came since the last call, the oldest first."""
        ...

    def close(self) -> None: ...


class UdpTransport:
    """The A1's UDP. Only datagrams from the robot's own address and port are heard."""

    def __init__(self, robot_address: str, local_port: int = 0) -> None:
        """``robot_address`` is host:port.

        Raises InputError for an address that is none, and Failure for what may be otherwise later:
        an unknown host, a network that is down, a port in use.
        """
        self.name = robot_address
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._open(_parse(robot_address), local_port)
        except BaseException:
            self._socket.close()
            raise

    def _open(self, robot: tuple[str, int], local_port: int) -> None:
        try:
            self._socket.bind(("", local_port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise Failure(f"UDP port {local_port} is in use") from error
            raise Failure(f"UDP port {local_port}: {error.strerror}") from error
        try:
            # the kernel then drops what others send before it can crowd out the robot
            self._socket.connect(robot)
        except socket.gaierror as error:
            why = f"unknown host {robot[0]!r} ({error.strerror})"
            raise Failure(f"robot address {self.name}: {why}") from error
        except TypeError as error:  # of a name that cannot be encoded
            raise InputError(f"robot address: {robot[0]!r} is no host name") from error
        except OSError as error:
            raise Failure(f"robot address {self.name}: {error.strerror}") from error
        self.receive()  # what anyone sent between the two calls

    def send(self, datagram: bytes) -> None:
        """Send one datagram; an unreachable robot or a full buffer counts as a loss."""
        with suppress(OSError):
            self._socket.send(datagram)

    def receive(self) -> list[bytes]:
        """What came since the last call, the oldest first."""
        datagrams = []
        for _ in range(_DRAIN):
            try:
                datagrams.append(self._socket.recv(_LONGEST))
            except BlockingIOError:
                break
            except OSError:  # an earlier send reached nobody
                continue
        return datagrams

    def close(self) -> None:
        self._socket.close()


def _parse(address: str) -> tuple[str, int]:
    host, colon, port = address.rpartition(":")
    if not (host and colon and port.isascii() and port.isdigit() and 0 < int(port) < 65536):
        raise InputError(f"robot address {address!r}: expected host:port, e.g. 127.0.0.1:8007")
    return host, int(port)
