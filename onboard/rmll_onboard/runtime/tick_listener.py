"""Takes each tick of a daemon, as what is recorded of it."""

from collections.abc import Callable, Sequence

import numpy as np

from rmll_onboard.recording.telemetry import ControllerSample, Tick
from rmll_onboard.runtime.daemon import Daemon


class TickListener:
    """Watches a daemon and passes its ticks on."""

    def __init__(self, daemon: Daemon, keep: Callable[[Tick], None]) -> None:
        self._daemon = daemon
        self._keep = keep
        self._number = 0

    def observe(self, now: int, datagrams: Sequence[bytes], answer: bytes) -> None:
        """The daemon has just answered."""
        daemon = self._daemon
        request, command = daemon.orders
        inside = _inside(daemon) if daemon.due else None
        self._keep(
            Tick(
                self._number, now, list(datagrams), answer, request, command,
                daemon.operator.by_remote, daemon.stopping, inside,
            )
        )  # fmt: skip
        self._number += 1


def _inside(daemon: Daemon) -> ControllerSample:
    controller = daemon.controller
    values = controller.observation, controller.estimate, controller.action, controller.target
    vx, wz, frequency = controller.command.tolist()
    return ControllerSample(
        daemon.mode,
        daemon.fault or "",
        controller.label,
        controller.state,
        controller.phi,
        controller.advanced,
        controller.off_spec,
        (vx, wz, frequency),
        np.concatenate(values, dtype=np.float32, casting="same_kind").tobytes(),
    )
