"""The A1's wireless remote: forty bytes at the end of every LowState.

Layout from unitree_legged_sdk's unitree_joystick.h. What a real A1 puts into the two head bytes and
the 16 unused ones is not documented, so they are not looked at here.
"""

import math
import struct
from dataclasses import dataclass
from enum import IntFlag, auto
from functools import lru_cache

LENGTH = 40
_LAYOUT = struct.Struct("<2xH5f16x")


class Button(IntFlag):
    """Bits of the buttons that are down, from bit 0 on."""

    NONE = 0
    R1 = auto()
    L1 = auto()
    START = auto()
    SELECT = auto()
    R2 = auto()
    L2 = auto()
    F1 = auto()
    F2 = auto()
    A = auto()
    B = auto()
    X = auto()
    Y = auto()
    UP = auto()
    RIGHT = auto()
    DOWN = auto()
    LEFT = auto()


_EMERGENCY = Button.L2 | Button.B


@dataclass(frozen=True, slots=True)
class Remote:
    """Buttons and sticks; a stick is -1 to 1, right and up positive."""

    buttons: Button = Button.NONE
    lx: float = 0.0
    ly: float = 0.0
    rx: float = 0.0
    ry: float = 0.0

    @property
    def emergency_stop(self) -> bool:
        """L2 and B together, as on the A1 itself."""
        return _EMERGENCY in self.buttons

    def held(self, deadband: float) -> bool:
        """Somebody presses a button, or pushes a stick further than it strays at rest."""
        sticks = self.lx, self.ly, self.rx, self.ry
        return bool(self.buttons) or any(abs(stick) > deadband for stick in sticks)

    @property
    def forward(self) -> float:
        """Share of the forward speed wanted, -1 to 1: the left stick, up is forward."""
        return self.ly

    @property
    def turn(self) -> float:
        """Share of the turning speed wanted, -1 to 1, left positive: the right stick."""
        return -self.rx


@lru_cache(maxsize=1)
def decode(data: bytes) -> Remote:
    """Read the remote's forty bytes. Raises ValueError if a stick is no finite number."""
    buttons, lx, rx, ry, _l2, ly = _LAYOUT.unpack(data)
    return Remote(Button(buttons), _stick(lx), _stick(ly), _stick(rx), _stick(ry))


def past(stick: float, deadband: float) -> float:
    """A stick's way beyond ``deadband``: 0 within it, from there steadily up to 1 or -1."""
    return math.copysign(max(0.0, abs(stick) - deadband) / (1 - deadband), stick)


def _stick(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"a stick of the remote is {value}")
    return min(1.0, max(-1.0, value))
