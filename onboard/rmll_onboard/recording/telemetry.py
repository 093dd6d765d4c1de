"""What is kept of a tick: what the daemon was given and what it gave, and at 50 Hz its inside.

A tick is taken from outside, after its command is on its way, and is small enough to be handed to
another process. A log holds nothing that is not in one.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

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


def row(
    now: int, inside: ControllerSample, states: Sequence[str], columns: Sequence[str]
) -> dict[str, Any]:
    """The inside as named plain values; flags are 0 or 1, so that they can be plotted."""
    vx, wz, frequency = inside.command
    numbers = np.frombuffer(inside.values, np.float32).tolist()
    return {
        "t_ns": now,
        "mode": inside.mode,
        "fault": inside.fault,
        "label": inside.label,
        **{f"down_{foot}": inside.label >> bit & 1 for bit, foot in enumerate(FEET)},
        "state": states[inside.state],
        "phi": inside.phi,
        "advanced": int(inside.advanced),
        "off_spec": int(inside.off_spec),
        "vx": vx,
        "wz": wz,
        "frequency": frequency,
        # nine digits bring a float32 back exactly
        **{name: float(f"{value:.9g}") for name, value in zip(columns, numbers, strict=True)},
    }


def _numbered(fields: Sequence[Field]) -> list[str]:
    return [
        field.name if field.size == 1 else f"{field.name}_{index}"
        for field in fields
        for index in range(field.size)
    ]
