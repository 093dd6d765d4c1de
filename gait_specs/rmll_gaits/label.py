"""Contact labels: which feet are down, as four bits.

Bit i of a label is foot i of ``FEET``: FR 1, FL 2, RR 4, RL 8. The paper's back feet BL and BR
are RL and RR. A foot's bit has hysteresis: contact sets it, clear air clears it, and anything
between keeps the last value, so a foot that skims the ground is not read as a step.

Plain operators only, so that Python bools, NumPy arrays and torch tensors run the same code.
"""

from typing import Any

FEET = ("FR", "FL", "RR", "RL")
NUM_LABELS = 1 << len(FEET)


def hysteresis(down: Any, touching: Any, clear: Any) -> Any:
    """New ``down`` flags (..., 4) from the last ones and two Boolean signals of the same shape.

    ``touching`` wins where both are true.
    """
    return touching | (down & ~clear)


def label(down: Any) -> Any:
    """Labels (...) from Boolean flags (..., 4) in the order of ``FEET``."""
    return down[..., 0] * 1 + down[..., 1] * 2 + down[..., 2] * 4 + down[..., 3] * 8


def feet(value: int) -> tuple[str, ...]:
    """Names of the feet that are down in a label."""
    return tuple(name for bit, name in enumerate(FEET) if value >> bit & 1)
