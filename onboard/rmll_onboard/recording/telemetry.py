"""What is kept of a tick: what the daemon was given and what it gave, and at 50 Hz its inside.

A tick is taken from outside, after its command is on its way, and is small enough to be handed to
another process. A log holds nothing that is not in one.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import cast

import msgspec
import numpy as np

from rmll_common.errors import InputError
from rmll_contract.contract import Contract
from rmll_contract.observation import Field
from rmll_gaits.label import FEET
from rmll_onboard.state.modes import Request


class ControllerSample(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """What the daemon thought, after the tick. Between walks the gait's entries stand still."""

    mode: str
    fault: str
    """Empty without one"""
    label: int
    """In a stop, which the clock leads, that of the pose in turn and not of what the feet feel"""
    state: int
    phi: int
    advanced: bool
    off_spec: bool
    command: tuple[float, float, float]
    """vx [m/s], wz [rad/s], c_f [policy steps]"""
    values: bytes
    """float32, named by :func:`columns`"""


class Tick(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One call of :meth:`rmll_onboard.runtime.daemon.Daemon.tick`."""

    number: int
    """Counts from 0, so that a gap shows"""
    now: int
    """[ns], monotonic"""
    datagrams: list[bytes]
    """From the robot, the oldest first; empty if none came"""
    answer: bytes
    """The datagram to the robot"""
    request: Request | None
    """The operator's, and so is the command"""
    command: tuple[float, float, float]
    by_remote: bool
    """The operator is who holds the wireless remote"""
    stopping: bool
    """The program was told to end"""
    inside: ControllerSample | None
    """At the policy's rate, else None"""


def columns(contract: Contract) -> list[str]:
    """Names of the numbers in :attr:`ControllerSample.values`."""
    joints = contract.joint_names
    return [
        *(f"observation_{name}" for name in _numbered(contract.observation)),
        *_numbered(contract.estimates),
        *(f"action_{name}" for name in joints),
        *(f"target_{name}" for name in joints),
    ]


class TelemetryRow(msgspec.Struct, frozen=True):
    """A ControllerSample as a log has it: named plain values, flags as 0 or 1, so that they can be
    plotted.

    The numbers of one gait's policy follow, see :func:`row_type`.
    """

    t_ns: int
    mode: str
    fault: str
    label: int
    down_FR: int  # as the feet are called, so that each is a column
    down_FL: int
    down_RR: int
    down_RL: int
    state: str
    phi: int
    advanced: int
    off_spec: int
    vx: float | None
    """JSON has a null for what is no number"""
    wz: float | None
    frequency: float | None


def row_type(columns: Sequence[str]) -> type[TelemetryRow]:
    """The rows of a log whose numbers are named ``columns``, each a field, a float or None.

    Raises InputError for names that cannot be fields; they may come from a file.
    """
    return _row_type(tuple(columns))


@lru_cache(maxsize=4)  # rows of two readers can be compared if they are of one type
def _row_type(columns: tuple[str, ...]) -> type[TelemetryRow]:
    for name in columns:
        if not name.isidentifier() or hasattr(TelemetryRow, name):
            raise InputError(f"{name!r} cannot be the name of a column")
    if len(set(columns)) < len(columns):
        raise InputError("two columns have the same name")
    numbers = [(name, float | None) for name in columns]
    kind = msgspec.defstruct("LogRow", numbers, bases=(TelemetryRow,), frozen=True)
    return cast("type[TelemetryRow]", kind)


def row(
    now: int, inside: ControllerSample, states: Sequence[str], kind: Callable[..., TelemetryRow]
) -> TelemetryRow:
    """The inside as a ``kind``, which is a :func:`row_type`."""
    # nine digits bring a float32 back exactly
    numbers = [float(f"{value:.9g}") for value in np.frombuffer(inside.values, np.float32).tolist()]
    return kind(
        now,
        inside.mode,
        inside.fault,
        inside.label,
        *(inside.label >> bit & 1 for bit in range(len(FEET))),
        states[inside.state],
        inside.phi,
        int(inside.advanced),
        int(inside.off_spec),
        *inside.command,
        *numbers,
    )


def _numbered(fields: Sequence[Field]) -> list[str]:
    return [
        field.name if field.size == 1 else f"{field.name}_{index}"
        for field in fields
        for index in range(field.size)
    ]
