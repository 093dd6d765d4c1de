"""What is asked of the robot: the commands and the seed of each walk."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from rmll_common.errors import InputError
from rmll_gaits.table import Commands, nearest

GRID_SPEEDS = 9


@dataclass(frozen=True)
class EvaluationCase:
    """One walk with one command."""

    vx: float
    """[m/s]"""
    wz: float
    """[rad/s]"""
    frequency: float
    """c_f [policy steps]"""
    seed: int
    """Of all randomness of the walk"""


def grid(
    commands: Commands,
    speeds: Sequence[float],
    frequencies: Sequence[float],
    repeats: int,
    seed: int,
) -> list[EvaluationCase]:
    """Straight walks at each speed and frequency, ``repeats`` times, each with a seed of its own.

    Without speeds, evenly spaced ones over what was trained; without frequencies, each whole one.
    Raises InputError, which names the flag, for a command that was not trained.
    """
    speeds = speeds or [float(v) for v in np.linspace(*commands.vx, GRID_SPEEDS)]
    frequencies = frequencies or _frequencies(commands)
    _check("speeds", speeds, commands.vx)
    _check("frequencies", frequencies, commands.frequency)
    straight = nearest(0.0, commands.wz)
    cells = product(sorted(set(speeds)), sorted(set(frequencies)), range(repeats))
    return [EvaluationCase(vx, straight, n, seed + index) for index, (vx, n, _) in enumerate(cells)]


def draw(commands: Commands, episodes: int, seed: int) -> list[EvaluationCase]:
    """Walks with commands drawn evenly from what was trained, c_f in whole steps as in training."""
    rng = np.random.default_rng(seed)
    frequencies = _frequencies(commands)
    return [
        EvaluationCase(
            vx=float(rng.uniform(*commands.vx)),
            wz=float(rng.uniform(*commands.wz)),
            frequency=frequencies[rng.integers(len(frequencies))],
            seed=seed + index,
        )
        for index in range(episodes)
    ]


def _frequencies(commands: Commands) -> list[float]:
    """Each c_f of whole policy steps that was trained; the middle of a range without any."""
    return [float(n) for n in commands.whole_frequencies] or [commands.middle_frequency]


def _check(flag: str, values: Sequence[float], limits: tuple[float, float]) -> None:
    low, high = limits
    for value in values:
        # written so that NaN is refused too
        if not low <= value <= high:
            raise InputError(f"--{flag} {value:g}: this gait was trained for {low:g} to {high:g}")
