"""A USB gamepad in the hands of the person who leads, read through Linux's evdev.

It has the buttons of the A1's own remote, so it is turned into one: START, SELECT, A, B, L2, the
directional pad and the two sticks, as the kernel's gamepad specification names them.
"""

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from rmll_common.errors import Failure
from rmll_gaits.table import Commands
from rmll_onboard.commands.operator import OperatorCommand, RemoteOperator
from rmll_onboard.protocol.a1_remote import Button, Remote
from rmll_onboard.state.modes import Mode, Request

# linux/input-event-codes.h
SYN, KEY, ABS = 0, 1, 3
DROPPED = 3
SOUTH = 0x130
KEYS = {
    SOUTH: Button.A,
    0x131: Button.B,
    0x138: Button.L2,
    0x13A: Button.SELECT,
    0x13B: Button.START,
    0x220: Button.UP,
    0x221: Button.DOWN,
}
X, Y, Z, RX, RY, HAT_Y = 0, 1, 2, 3, 4, 0x11


class Device(Protocol):
    """What is used of an ``evdev.InputDevice``."""

    def read(self) -> Iterable[Any]:
        """The events since the last call; raises OSError without any, or without a device."""
        ...

    def active_keys(self) -> list[int]: ...

    def absinfo(self, axis_num: int) -> Any: ...

    def capabilities(self) -> dict[int, list[Any]]: ...

    def close(self) -> None: ...


class Gamepad:
    """The state of a gamepad, as the A1's remote would tell it."""

    def __init__(self, device: Device) -> None:
        self.plugged_in = True
        self._device = device
        self._range = {
            axis: (info.min, info.max) for axis, info in device.capabilities().get(ABS, [])
        }
        self._keys: set[int] = set()
        self._axes: dict[int, float] = {}
        self._look()

    def read(self) -> Remote:
        """Never waits. A gamepad that is gone has all released, and stays gone."""
        if self.plugged_in:
            try:
                for event in self._device.read():
                    self._take(event.type, event.code, event.value)
            except BlockingIOError:
                pass
            except OSError:
                self.plugged_in = False
        return self._remote() if self.plugged_in else Remote()

    def close(self) -> None:
        self._device.close()

    def _look(self) -> None:
        """Ask for everything: at the start, and after the kernel has dropped events."""
        self._keys = set(self._device.active_keys())
        self._axes = {axis: self._device.absinfo(axis).value for axis in self._range}

    def _take(self, kind: int, code: int, value: int) -> None:
        if kind == SYN and code == DROPPED:
            self._look()
        elif kind == KEY and value:
            self._keys.add(code)
        elif kind == KEY:
            self._keys.discard(code)
        elif kind == ABS:
            self._axes[code] = value

    def _remote(self) -> Remote:
        buttons = Button.NONE
        for code in self._keys & KEYS.keys():
            buttons |= KEYS[code]
        # many pads have L2 as an axis; without RX that axis is the right stick
        if RX in self._range and self._share(Z) > 0:
            buttons |= Button.L2
        if hat := self._axes.get(HAT_Y, 0):
            buttons |= Button.UP if hat < 0 else Button.DOWN
        # down is positive for the kernel
        lx, ly, rx, ry = self._share(X), -self._share(Y), self._share(RX), -self._share(RY)
        return Remote(buttons, lx, ly, rx, ry)

    def _share(self, axis: int) -> float:
        """-1 to 1 on the way from an axis's least value to its greatest, 0 in the middle."""
        low, high = self._range.get(axis, (0, 0))
        if high <= low:
            return 0.0
        return min(1.0, max(-1.0, 2 * (self._axes[axis] - low) / (high - low) - 1))


class GamepadOperator:
    """Leads as :class:`RemoteOperator` does; a gamepad that is pulled out ends the walk."""

    by_remote = False

    def __init__(
        self, gamepad: Gamepad, commands: Commands, frequency: float, deadband: float
    ) -> None:
        self.complaint: str | None = None
        self._gamepad = gamepad
        self._operator = RemoteOperator(commands, frequency, deadband)

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        pressed = self._gamepad.read()
        orders = self._operator.orders(now, mode, pressed)
        if pressed.emergency_stop:
            return orders._replace(request=Request.DAMP)
        if not self._gamepad.plugged_in:
            self.complaint = "the gamepad was unplugged"
            request = Request.STAND if mode is Mode.WALKING else None
            return orders._replace(request=request)
        return orders

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return False

    def close(self) -> None:
        self._gamepad.close()


def open_gamepad(path: Path | None) -> Gamepad:
    """The gamepad at ``path``, such as /dev/input/event3; None takes the first one.

    Raises Failure if there is none, or if the package evdev is not there.
    """
    try:
        evdev: Any = import_module("evdev")
    except ImportError as error:
        raise Failure(
            "--gamepad: evdev is not installed; run: pip install 'rmll[gamepad]'"
        ) from error
    try:
        paths = evdev.list_devices() if path is None else [str(path)]
        for name in paths:
            device = evdev.InputDevice(name)
            if SOUTH in device.capabilities().get(KEY, []):
                return Gamepad(device)
            device.close()
    except OSError as error:
        raise Failure(f"--gamepad {path}: {error.strerror or error}") from error
    found = f"none among {', '.join(paths)}" if paths else "no device that this user may read"
    raise Failure(f"--gamepad: {found} in /dev/input; is it plugged in?")
