"""The compiled gait: per automaton state, what each of the 16 contact labels does.

This one table trains the policy, travels in the bundle, steers the robot and judges logs.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TypedDict

import msgspec
import numpy as np
from numpy.typing import NDArray

from rmll_common.errors import InputError
from rmll_gaits.label import NUM_LABELS

STAY, ADVANCE, REJECT = 0, 1, 2
"""Effects of a label: wait in the state; take the edge and earn the bonus; fall into the sink."""

MAX_STATES = 64


def nearest(value: float, limits: tuple[float, float]) -> float:
    """The number within ``limits`` (low, high) that is nearest to ``value``."""
    low, high = limits
    return min(max(value, low), high)


@dataclass(frozen=True)
class Commands:
    """Ranges (low, high) from which commands are drawn, and to which they are clamped."""

    vx: tuple[float, float]
    """[m/s], forward positive"""
    wz: tuple[float, float]
    """[rad/s], left positive"""
    frequency: tuple[float, float]
    """c_f [policy steps], the least time between two transitions"""

    @property
    def whole_frequencies(self) -> range:
        """The c_f of whole policy steps; none in a range such as [6.2, 6.8]."""
        low, high = self.frequency
        return range(math.ceil(low), math.floor(high) + 1)

    @property
    def middle_frequency(self) -> float:
        """c_f where nobody chose one: the middle, in whole policy steps where there are some."""
        middle = sum(self.frequency) / 2
        whole = round(middle)
        return float(whole) if whole in self.whole_frequencies else middle


class PlainTable(TypedDict):
    """A table as JSON has it."""

    gait: str
    states: list[str]
    start: int
    sink: int | None
    commands: dict[str, list[float]]
    next_state: list[list[int]]
    effect: list[list[int]]
    dwell: list[list[float]]
    grace: list[list[int]]
    hold: list[list[bool]]


@dataclass(frozen=True, eq=False)
class MachineTable:
    """Automaton of one gait. Arrays are read-only, (states, 16), indexed [state, label].

    A table is equal to itself alone, so that it can be a key.
    """

    gait: str
    states: tuple[str, ...]
    start: int
    sink: int | None
    """Index of the state that a reject edge leads to, None without reject edges"""
    commands: Commands
    next_state: NDArray[np.int64]
    effect: NDArray[np.int64]
    dwell: NDArray[np.float64]
    """Factor of c_f: the edge is closed until phi >= dwell * c_f; 0 opens it at once"""
    grace: NDArray[np.int64]
    """A reject edge is closed during the first ``grace`` policy steps of an episode"""
    hold: NDArray[np.bool_]
    """Labels that are as expected while waiting in the state"""

    def __post_init__(self) -> None:
        shape = (len(self.states), NUM_LABELS)
        for name, kind in _ARRAYS.items():
            given = np.asarray(getattr(self, name))
            if not np.can_cast(given.dtype, kind, "same_kind"):  # 1.5 is no state, and nan none
                raise InputError(f"gait table: {name} has {given.dtype}, expected {kind.__name__}")
            array = np.ascontiguousarray(given, dtype=kind)
            if array.shape != shape:
                raise InputError(f"gait table: {name} has shape {array.shape}, expected {shape}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        self._check()

    def _check(self) -> None:
        count = len(self.states)
        indices = [self.start] + ([] if self.sink is None else [self.sink])
        if not 0 < count <= MAX_STATES:
            raise InputError(f"gait table: {count} states, expected 1 to {MAX_STATES}")
        if not all(0 <= index < count for index in indices):
            raise InputError(f"gait table: start or sink outside 0..{count - 1}")
        if self.next_state.min() < 0 or self.next_state.max() >= count:
            raise InputError(f"gait table: next_state outside 0..{count - 1}")
        if self.effect.min() < STAY or self.effect.max() > REJECT:
            raise InputError("gait table: effect is not 0 (stay), 1 (advance) or 2 (reject)")
        if not np.isfinite(self.dwell).all() or self.dwell.min() < 0 or self.grace.min() < 0:
            raise InputError("gait table: dwell and grace must be finite and not negative")
        stays = np.arange(count)[:, None]
        if ((self.effect == STAY) & (self.next_state != stays)).any():
            raise InputError("gait table: a label that stays leads to another state")

    @property
    def num_states(self) -> int:
        return len(self.states)

    @property
    def rules(self) -> str:
        """Digest of the rules: gaits that have it in common are one gait, whatever they are called.

        Everything counts but names: the gait's, those of its states, its description. A policy sees
        its states by their order, and was trained within the ranges of its commands.
        """
        rules = {**self.to_dict(), "gait": "", "states": self.num_states}
        return hashlib.sha256(json.dumps(rules, sort_keys=True).encode()).hexdigest()

    def to_dict(self) -> PlainTable:
        """Plain lists and numbers, exact, for JSON."""
        return {
            "gait": self.gait,
            "states": list(self.states),
            "start": self.start,
            "sink": self.sink,
            "commands": {f.name: list(getattr(self.commands, f.name)) for f in fields(Commands)},
            "next_state": self.next_state.tolist(),
            "effect": self.effect.tolist(),
            "dwell": self.dwell.tolist(),
            "grace": self.grace.tolist(),
            "hold": self.hold.tolist(),
        }

    @classmethod
    def from_dict(cls, plain: Mapping[str, object]) -> "MachineTable":
        """Inverse of :meth:`to_dict`; raises InputError on anything that is no table."""
        try:
            return cls(
                gait=msgspec.convert(plain["gait"], str),
                states=msgspec.convert(plain["states"], tuple[str, ...]),
                start=msgspec.convert(plain["start"], int),
                sink=msgspec.convert(plain["sink"], int | None),
                commands=msgspec.convert(plain["commands"], Commands),
                **{name: np.array(plain[name]) for name in _ARRAYS},
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"gait table: cannot be read ({error!r})") from error


_ARRAYS = {
    "next_state": np.int64,
    "effect": np.int64,
    "dwell": np.float64,
    "grace": np.int64,
    "hold": np.bool_,
}
