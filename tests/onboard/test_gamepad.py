"""A gamepad in place of the remote. Its events come from a list, and from a virtual device where
the machine has one."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rmll_common.errors import Failure
from rmll_gaits.table import Commands
from rmll_onboard.commands.gamepad import (
    ABS,
    DROPPED,
    HAT_Y,
    KEY,
    RX,
    RY,
    SOUTH,
    SYN,
    Gamepad,
    GamepadOperator,
    X,
    Y,
    Z,
    open_gamepad,
)
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.protocol.a1_remote import Button, Remote
from rmll_onboard.state.modes import Mode, Request

RANGES = Commands(vx=(-0.5, 1.0), wz=(-1.0, 1.0), frequency=(6.0, 12.0))
EAST, SELECT, START, DPAD_UP, DPAD_DOWN = 0x131, 0x13A, 0x13B, 0x220, 0x221
AXES = {X: (-32768, 32767), Y: (-32768, 32767), RX: (-32768, 32767), RY: (-32768, 32767),
        Z: (0, 255), HAT_Y: (-1, 1)}  # fmt: skip


class Pad:
    """What an ``evdev.InputDevice`` does, as far as it is used."""

    def __init__(self, axes: dict[int, tuple[int, int]] = AXES) -> None:
        self.ranges = axes
        self.keys: set[int] = set()
        self.axes = {axis: max(low, 0) for axis, (low, _) in axes.items()}
        self.waiting: list[SimpleNamespace] = []
        self.gone = False

    def press(self, *codes: int, value: int = 1) -> None:
        for code in codes:
            (self.keys.add if value else self.keys.discard)(code)
            self.waiting.append(SimpleNamespace(type=KEY, code=code, value=value))

    def move(self, axis: int, value: int) -> None:
        self.axes[axis] = value
        self.waiting.append(SimpleNamespace(type=ABS, code=axis, value=value))

    def read(self):
        if self.gone:
            raise OSError(19, "No such device")
        if not self.waiting:
            raise BlockingIOError(11, "nothing there")
        waiting, self.waiting = self.waiting, []
        yield from waiting

    def active_keys(self):
        return list(self.keys)

    def absinfo(self, axis):
        low, high = self.ranges[axis]
        return SimpleNamespace(value=self.axes[axis], min=low, max=high)

    def capabilities(self):
        return {KEY: [SOUTH], ABS: [(axis, self.absinfo(axis)) for axis in self.ranges]}

    def close(self) -> None: ...


@pytest.fixture
def pad():
    return Pad()


def test_sticks_and_buttons_read_as_the_remotes_do(pad):
    gamepad = Gamepad(pad)
    got = gamepad.read()
    # the middle of an axis of 65,536 values lies between two of them
    assert got.buttons == Button.NONE
    assert (got.lx, got.ly, got.rx, got.ry) == pytest.approx((0, 0, 0, 0), abs=1e-4)
    pad.press(SOUTH, START, EAST, SELECT)
    pad.move(Y, -32768)
    pad.move(X, 32767)
    pad.move(RX, 16384)
    pad.move(RY, 2000)
    got = gamepad.read()
    assert got.buttons == Button.A | Button.START | Button.B | Button.SELECT
    assert (got.ly, got.lx) == (1.0, 1.0)
    assert got.ry == pytest.approx(-0.061, abs=1e-3)  # what it strays at rest is not judged here
    assert got.rx == pytest.approx(0.5, abs=0.01)
    assert gamepad.read() == got  # what is held stays held
    pad.press(SOUTH, EAST, value=0)
    assert gamepad.read().buttons == Button.START | Button.SELECT


def test_what_is_held_already_when_it_starts_counts(pad):
    pad.press(START)
    pad.waiting.clear()
    assert Gamepad(pad).read().buttons == Button.START


def test_after_dropped_events_it_looks_again(pad):
    gamepad = Gamepad(pad)
    pad.press(SOUTH)
    pad.move(Y, 32767)
    pad.waiting = [SimpleNamespace(type=SYN, code=DROPPED, value=0)]
    got = gamepad.read()
    assert (got.buttons, got.ly) == (Button.A, -1.0)


def test_the_directional_pad_is_an_axis_or_four_buttons(pad):
    gamepad = Gamepad(pad)
    pad.move(HAT_Y, -1)
    assert gamepad.read().buttons == Button.UP
    pad.move(HAT_Y, 1)
    assert gamepad.read().buttons == Button.DOWN
    pad.move(HAT_Y, 0)
    pad.press(DPAD_UP)
    assert gamepad.read().buttons == Button.UP


def test_a_trigger_that_is_an_axis_is_l2_but_a_right_stick_is_not():
    pad = Pad()
    pad.move(Z, 255)
    assert Gamepad(pad).read().buttons == Button.L2
    pad = Pad({X: (0, 255), Y: (0, 255), Z: (0, 255)})
    pad.move(Z, 255)
    assert Gamepad(pad).read().buttons == Button.NONE


def test_it_leads_a_robot(pad):
    operator = GamepadOperator(Gamepad(pad), RANGES, 9.0, 0.08)
    pad.press(START)
    assert operator.orders(0, Mode.DAMPING, Remote()).request is Request.STAND
    pad.press(START, value=0)
    pad.press(SOUTH, DPAD_UP)
    pad.move(Y, 32767)
    assert operator.orders(0, Mode.WALKING, Remote()) == OperatorCommand(
        Request.WALK, (-0.5, 0.0, 8.0)
    )
    # held, it counts once
    assert operator.orders(0, Mode.WALKING, Remote()).command[2] == 8.0
    pad.press(SOUTH, DPAD_UP, value=0)
    pad.press(EAST)
    assert operator.orders(0, Mode.WALKING, Remote()).request is Request.STAND
    pad.move(Z, 255)
    assert operator.orders(0, Mode.WALKING, Remote()).request is Request.DAMP


def test_a_stick_that_strays_at_rest_is_none(pad):
    operator = GamepadOperator(Gamepad(pad), RANGES, 9.0, deadband=0.08)
    pad.move(Y, 2000)
    pad.move(RX, -2000)
    assert operator.orders(0, Mode.WALKING, Remote()).command[:2] == (0, 0)


def test_pulled_out_it_ends_the_walk(pad):
    operator = GamepadOperator(Gamepad(pad), RANGES, 9.0, 0.08)
    pad.press(SOUTH)
    pad.move(Y, -32768)
    assert operator.orders(0, Mode.WALKING, Remote()).command[0] == 1.0
    pad.gone = True
    for _ in range(2):
        assert operator.orders(0, Mode.WALKING, Remote()) == OperatorCommand(
            Request.STAND, (0.0, 0.0, 9.0)
        )
    assert operator.complaint == "the gamepad was unplugged"
    assert operator.orders(0, Mode.STANDING, Remote()).request is None


def test_without_evdev_one_line_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(Failure, match=r"pip install 'rmll\[gamepad\]'"):
        open_gamepad(None)


def test_without_a_gamepad_one_line_says_so(monkeypatch):
    pytest.importorskip("evdev")
    with pytest.raises(Failure, match="event999: No such file"):
        open_gamepad(Path("/dev/input/event999"))
    monkeypatch.setattr("evdev.list_devices", list)
    with pytest.raises(Failure, match="is it plugged in"):
        open_gamepad(None)


def test_a_virtual_gamepad_of_the_kernels():
    evdev = pytest.importorskip("evdev")
    if not Path("/dev/uinput").exists():
        pytest.skip("needs Linux's uinput")
    axis = evdev.AbsInfo(0, -100, 100, 0, 0, 0)
    with evdev.UInput({KEY: [SOUTH, START], ABS: [(X, axis), (Y, axis)]}) as virtual:
        gamepad = open_gamepad(Path(virtual.device.path))
        virtual.write(KEY, SOUTH, 1)
        virtual.write(ABS, Y, -100)
        virtual.syn()
        got = gamepad.read()
        assert (got.buttons, got.ly) == (Button.A, 1.0)
        gamepad.close()
