"""What a run is to do: one command for so long, at a gait's own frequency unless told."""

from dataclasses import dataclass
from statistics import fmean

from rmll_gaits.errors import InputError
from rmll_gaits.table import Commands


@dataclass(frozen=True)
class Plan:
    """Stand up, walk for ``seconds`` with one command, sit down."""

    seconds: float
    vx: float
    """[m/s]"""
    wz: float
    """[rad/s]"""
    frequency: float
    """c_f [policy steps]"""

    @property
    def flags(self) -> list[str]:
        """As flags of ``rmll-onboard``."""
        values = {
            "seconds": self.seconds,
            "vx": self.vx,
            "wz": self.wz,
            "frequency": self.frequency,
        }
        return [text for name, value in values.items() for text in (f"--{name}", repr(value))]


def plan(commands: Commands, seconds: float, vx: float, wz: float, frequency: float | None) -> Plan:
    """A plan for a gait; without a frequency, the middle of what was trained.

    Raises InputError for a command outside what the gait was trained for.
    """
    if not seconds > 0:
        raise InputError(f"--seconds {seconds:g}: expected more than 0")
    made = Plan(
        seconds, vx, wz, float(round(fmean(commands.frequency))) if frequency is None else frequency
    )
    for name in ("vx", "wz", "frequency"):
        value, (low, high) = getattr(made, name), getattr(commands, name)
        if not low <= value <= high:
            raise InputError(f"--{name} {value:g}: this gait was trained for {low:g} to {high:g}")
    return made
