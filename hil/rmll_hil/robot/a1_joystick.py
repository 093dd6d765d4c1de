"""The forty bytes that the A1's board passes on from its wireless remote, as the board writes them.

From the vendor's unitree_joystick.h: two bytes of head, sixteen buttons, five floats, sixteen bytes
without a use. Little-endian.
"""

import struct

SIZE = 40
BUTTONS = (
    "R1", "L1", "START", "SELECT", "R2", "L2", "F1", "F2",
    "A", "B", "X", "Y", "UP", "RIGHT", "DOWN", "LEFT",
)  # fmt: skip
"""By bit, from the lowest on"""
HEAD = b"\x55\x51"
"""In front while there is a remote. Assumption: the A1's is not published"""


def press(
    *buttons: str,
    lx: float = 0.0,
    ly: float = 0.0,
    rx: float = 0.0,
    ry: float = 0.0,
    head: bytes = HEAD,
) -> bytes:
    """What is sent while these buttons are down; a stick is -1 to 1, right and up positive."""
    bits = sum(1 << BUTTONS.index(button) for button in set(buttons))
    pulled = float("L2" in buttons)  # a key that is sent as an analog one too
    return head + struct.pack("<H5f", bits, lx, rx, ry, pulled, ly) + bytes(16)
