"""Numbers given on the command line."""

import math

from rmll_common.errors import InputError


def within(flag: str, value: float, low: float, high: float = math.inf) -> None:
    """Raises InputError, which names the flag, for a value outside, NaN among them."""
    # written so that NaN is refused too
    if not low <= value <= high:
        wanted = (
            f"at least {_plain(low)}" if high == math.inf else f"{_plain(low)} to {_plain(high)}"
        )
        raise InputError(f"--{flag} {_plain(value)}: expected {wanted}")


def _plain(value: float) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
