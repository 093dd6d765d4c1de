"""Commands from a program on this computer: JSON datagrams on a UNIX socket.

One message is the whole wish, and holds for as long as messages keep coming:

    {"request": "walk", "vx": 0.5, "wz": 0.0, "frequency": 9}

``request`` is stand, walk, sit or damp (for good), or left out; vx [m/s] and wz [rad/s] are 0 if
left out; frequency, c_f [policy steps], stays as it was. Values beyond what was trained are
clamped. No network is involved, and only the user who runs the daemon may write.
"""

import os
import socket
import stat
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from rmll_common.errors import Failure, InputError
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.protocol.a1_remote import Remote
from rmll_onboard.state.modes import NS, Mode, Request

LONGEST = 256
"""Bytes of a message"""
_DRAIN = 8
"""Messages read in a tick; more of them wait"""

Number = Annotated[float, Meta(ge=-100, le=100)]


class SocketCommand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A message."""

    request: Request | None = None
    vx: Number = 0.0
    wz: Number = 0.0
    frequency: Number | None = None


class SocketOperator:
    """Follows the newest message; after ``silence`` seconds without one a walking robot stands."""

    by_remote = False

    def __init__(self, path: Path, frequency: float, silence: float) -> None:
        """``frequency`` is c_f until a message says another.

        Raises InputError for a path that cannot be a socket, Failure if somebody listens there.
        """
        self.complaint: str | None = None
        self._path = path
        self._frequency = frequency
        self._silence = int(silence * NS)
        self._wish = SocketCommand()
        self._heard: int | None = None
        self._socket = _bound(path)

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        for _ in range(_DRAIN):
            try:
                message = self._socket.recv(LONGEST + 1)
            except OSError:
                break
            self._take(now, message)
        if self._heard is not None and now - self._heard <= self._silence:
            wish = self._wish
            return OperatorCommand(wish.request, (wish.vx, wish.wz, self._frequency))
        request = None
        if mode is Mode.WALKING:
            request = Request.STAND
            self.complaint = "command socket: no message for too long while walking"
        return OperatorCommand(request, (0.0, 0.0, self._frequency))

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return False

    def close(self) -> None:
        self._socket.close()
        with suppress(OSError):
            self._path.unlink()

    def _take(self, now: int, message: bytes) -> None:
        """Follow a message; a bad one is told and changes nothing."""
        try:
            self._wish = decode(message)
        except InputError as error:
            self.complaint = f"command socket: {error}"
            return
        self._heard = now
        if self._wish.frequency is not None:
            self._frequency = self._wish.frequency


def decode(message: bytes) -> SocketCommand:
    """Read a message. Raises InputError, which says what is wrong with it."""
    if len(message) > LONGEST:
        raise InputError(f"a message of more than {LONGEST} bytes")
    try:
        return msgspec.json.decode(message, type=SocketCommand)
    except msgspec.DecodeError as error:
        raise InputError(f"refused a message: {error}") from error


def _bound(path: Path) -> socket.socket:
    _remove_stale(path)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    sock.setblocking(False)
    before = os.umask(0o177)
    try:
        sock.bind(str(path))
    except OSError as error:
        sock.close()
        raise InputError(f"--commands {path}: {error.strerror or error}") from error
    finally:
        os.umask(before)
    return sock


def _remove_stale(path: Path) -> None:
    """Take away a socket that a daemon left behind, and nothing else."""
    try:
        kind = path.lstat().st_mode
    except OSError:
        return
    if not stat.S_ISSOCK(kind):
        raise InputError(f"--commands {path}: exists already and is no socket")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
        except OSError as error:
            raise InputError(f"--commands {path}: {error.strerror or error}") from error
        else:
            raise Failure(f"--commands {path}: another daemon listens there")
