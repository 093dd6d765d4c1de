"""Poses in words: the feet in contact by the paper's names, ``FL BR``; ``none`` is all in the air.

Front and back, left and right. The robot's own names RL and RR are accepted for BL and BR.
"""

from rmll_common.errors import InputError
from rmll_gaits.label import FEET, NUM_LABELS

PAPER_FEET = ("FL", "FR", "BL", "BR")
"""The order of the paper's figures, and of everything shown to people"""

BITS = {foot: 1 << bit for bit, foot in enumerate(FEET)}
"""Bit of each accepted foot name: FR 1, FL 2, BR or RR 4, BL or RL 8"""
BITS |= {"BR": BITS["RR"], "BL": BITS["RL"]}

NO_FEET = "none"

ALL_DOWN = NUM_LABELS - 1
"""The label of a robot that stands on all feet"""


def to_label(pose: str) -> int:
    """Label of a pose such as ``FL BR``; InputError for an unknown or repeated foot."""
    label = 0
    for name in [] if pose.split() == [NO_FEET] else pose.split():
        if name not in BITS:
            feet = " ".join(PAPER_FEET)
            raise InputError(f"found {name!r} in a pose, expected feet ({feet}) or {NO_FEET!r}")
        if label & BITS[name]:
            raise InputError(f"foot {name} twice in a pose")
        label |= BITS[name]
    return label


def to_text(label: int) -> str:
    """The pose of a label, ``FL BR``; inverse of :func:`to_label`."""
    return " ".join(name for name in PAPER_FEET if label & BITS[name]) or NO_FEET


def to_guard(label: int) -> str:
    """The formula that is true for this label alone, ``FL & !FR & !BL & BR``."""
    return " & ".join(name if label & BITS[name] else f"!{name}" for name in PAPER_FEET)
