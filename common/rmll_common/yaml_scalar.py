"""What a plain YAML scalar stands for, the same in every file: ``1e-3``, ``on``, ``0x100``.

The core schema of YAML 1.2, and its predecessor's yes, no, on and off. A number of one version that
is another number or a text in the other is refused: YAML 1.1 has ``010`` for 8 and ``1:0`` for 60.
"""

import math
import re
from collections.abc import Callable

Scalar = None | bool | int | float | str

LONGEST = 40
"""Characters of a number; what is longer is a text"""

_NULL = re.compile(r"|~|null|Null|NULL")
_TRUE = re.compile(r"true|True|TRUE|yes|Yes|YES|on|On|ON")
_FALSE = re.compile(r"false|False|FALSE|no|No|NO|off|Off|OFF")
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_HEXADECIMAL = re.compile(r"[-+]?0x[0-9a-fA-F]+")
_FRACTION = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


def _base_60(text: str) -> str:
    sign = "-" if text.startswith("-") else ""
    total = 0.0
    for digits in text.lstrip("+-").split(":"):
        total = 60 * total + float(digits)
    return f"{sign}{total:.15g}"


_DISPUTED: tuple[tuple[re.Pattern[str], Callable[[str], str]], ...] = (
    (re.compile(r"[-+]?0o[0-7]+"), lambda text: f"{int(text, 8)}"),
    (re.compile(r"[-+]?0+[0-7]"), lambda text: f"{int(text)}"),
    (re.compile(r"[-+]?0[0-7]+"), lambda text: f"{int(text, 8)} or {int(text)}"),
    (re.compile(r"[-+]?0[0-9]+"), lambda text: f"{int(text)}"),
    (re.compile(r"[-+]?0b[01]+"), lambda text: f"{int(text, 2)}"),
    (re.compile(r"[-+]?[0-9]+(:[0-5]?[0-9])+(\.[0-9]*)?"), _base_60),
)
"""What such a number may look like, and how else to write it"""


def read(text: str) -> Scalar:
    """The value of a plain scalar; raises ValueError that says what to write instead."""
    if _NULL.fullmatch(text):
        return None
    if _TRUE.fullmatch(text) or _FALSE.fullmatch(text):
        return _TRUE.fullmatch(text) is not None
    if len(text) > LONGEST:
        return text
    if _WHOLE.fullmatch(text):
        return int(text)
    if _HEXADECIMAL.fullmatch(text):
        return int(text, 16)
    if advice := _advice(text):
        raise ValueError(f"found {text}, which readers of YAML take differently: write {advice}")
    if _NOT_FINITE.fullmatch(text):
        raise ValueError(f"found {text}, expected a finite number")
    return _fraction(text) if _FRACTION.fullmatch(text) else text


def _fraction(text: str) -> int | float:
    """``3e6`` is a whole number too, and may be written where one is expected."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"found {text}, expected a finite number")
    whole = "e" in text.lower() and number.is_integer() and abs(number) < 2**53
    return int(number) if whole else number


def _advice(text: str) -> str | None:
    """What to write for a number of one version of YAML alone; None for anything else."""
    bare = text[:1] + text[1:].replace("_", "")
    written = next((write(bare) for form, write in _DISPUTED if form.fullmatch(bare)), None)
    numbers = (_WHOLE, _HEXADECIMAL, _FRACTION)
    if written is None and bare != text and any(form.fullmatch(bare) for form in numbers):
        written = bare
    return written and f'{written}, or "{text}" for a text'
