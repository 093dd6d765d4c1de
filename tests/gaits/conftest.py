"""Tables without any sense, for properties that hold for all tables."""

from collections.abc import Callable

import numpy as np
import pytest

from rmll_gaits.label import NUM_LABELS
from rmll_gaits.table import REJECT, STAY, Commands, MachineTable


def _random_table(seed: int) -> MachineTable:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 6))
    shape = (count, NUM_LABELS)
    effect = rng.integers(STAY, REJECT + 1, shape)
    anywhere = rng.integers(0, count, shape)
    stays = np.arange(count)[:, None]
    return MachineTable(
        gait="random",
        states=tuple(f"q{i}" for i in range(count)),
        start=int(rng.integers(count)),
        sink=count - 1,
        commands=Commands((-1.0, 1 / 3), (-0.1, 0.1), (5.0, 12.0)),
        next_state=np.where(effect == STAY, stays, anywhere),
        effect=effect,
        dwell=rng.choice([0.0, 1 / 3, 0.5, 1.0, 2.0], shape),
        grace=rng.integers(0, 20, shape),
        hold=rng.random(shape) < 0.5,
    )


@pytest.fixture(scope="session")
def random_table() -> Callable[[int], MachineTable]:
    """Builds a table from a seed."""
    return _random_table
