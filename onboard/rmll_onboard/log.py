"""The policy's inside at 50 Hz, kept in memory and written as CSV when the program ends."""

import csv
from collections.abc import Sequence
from typing import TextIO

import numpy as np

from rmll_contract.observation import Field
from rmll_gaits.label import FEET
from rmll_onboard.bundle import Bundle
from rmll_onboard.controller import Controller
from rmll_onboard.supervisor import Mode

ROWS = 90_000
"""Half an hour; then the oldest rows are overwritten"""

_MODES = list(Mode)


class Log:
    """A ring of rows. Between walks the columns of the gait keep their last values."""

    def __init__(self, bundle: Bundle, rows: int = ROWS) -> None:
        joints = bundle.contract.joint_names
        self._states = bundle.table.states
        self._numbers = [
            *("phi", "advanced", "off_spec", "vx", "wz", "frequency"),
            *_columns(bundle.contract.estimates),
            *(f"action_{name}" for name in joints),
            *(f"target_{name}" for name in joints),
        ]
        # untouched pages of empty arrays take no memory
        self._time = np.empty(rows, np.int64)
        self._discrete = np.empty((rows, 3), np.int16)
        self._values = np.empty((rows, len(self._numbers)), np.float32)
        self._count = 0

    def append(self, now: int, mode: Mode, controller: Controller) -> None:
        """Keep what ``controller`` did at ``now`` [ns]."""
        row = self._count % len(self._time)
        self._count += 1
        self._time[row] = now
        self._discrete[row] = _MODES.index(mode), controller.label, controller.state
        np.concatenate(
            (
                (controller.phi, controller.advanced, controller.off_spec),
                controller.command,
                controller.estimate,
                controller.action,
                controller.target,
            ),
            out=self._values[row],
            casting="same_kind",
        )

    def write(self, file: TextIO) -> None:
        """All rows, the oldest first."""
        writer = csv.writer(file)
        writer.writerow(
            ["t_ns", "mode", "label", *(f"down_{foot}" for foot in FEET), "state", *self._numbers]
        )
        for count in range(max(0, self._count - len(self._time)), self._count):
            row = count % len(self._time)
            mode, label, state = self._discrete[row].tolist()
            down = [label >> bit & 1 for bit in range(len(FEET))]
            # nine digits bring a float32 back exactly
            values = [f"{value:.9g}" for value in self._values[row].tolist()]
            writer.writerow(
                [self._time[row], _MODES[mode], label, *down, self._states[state], *values]
            )


def _columns(fields: Sequence[Field]) -> list[str]:
    return [f"{field.name}_{index}" for field in fields for index in range(field.size)]
