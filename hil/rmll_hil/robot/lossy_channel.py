"""The network between daemon and robot, with the faults of the plan."""

from heapq import heappop, heappush
from itertools import count
from typing import Any

import numpy as np

from rmll_hil.robot import fault_plan
from rmll_hil.robot.fault_plan import Plan

_HELD_BACK_MS = 8.0
"""For longer than a control period, so that the next datagram overtakes"""


class LossyChannel:
    """One direction. Datagrams go in and, if they do, come out later; times in ms."""

    def __init__(self, plan: Plan, direction: str, rng: np.random.Generator) -> None:
        self.sent = 0
        """Datagrams that went in"""
        self._direction = direction
        self.follow(plan)
        self._rng = rng
        self._order = count()
        self._under_way: list[tuple[float, int, bytes, Any]] = []

    def follow(self, plan: Plan) -> None:
        """Have another plan's faults from now on; what is under way stays so."""
        self._faults = [
            fault
            for fault in plan
            if isinstance(fault, fault_plan.Network)
            and fault.direction in ("both", self._direction)
        ]

    def send(self, datagram: bytes, now_ms: int, sender: Any = None) -> None:
        """Put a datagram on its way; ``sender`` comes out with it."""
        self.sent += 1
        copies = [(float(now_ms), datagram)]
        for fault in self._faults:
            if fault.active(now_ms):
                copies = [late for due, copy in copies for late in self._impair(fault, due, copy)]
        for due, copy in copies:
            heappush(self._under_way, (due, next(self._order), copy, sender))

    def arrived(self, now_ms: int) -> list[tuple[bytes, Any]]:
        """Datagrams and their senders that have come by now, each one once."""
        came = []
        while self._under_way and self._under_way[0][0] <= now_ms:
            _, _, datagram, sender = heappop(self._under_way)
            came.append((datagram, sender))
        return came

    def _impair(
        self, fault: fault_plan.Network, due: float, datagram: bytes
    ) -> list[tuple[float, bytes]]:
        """What becomes of a datagram: when it arrives, and as what."""
        rng = self._rng
        if rng.random() < fault.loss:
            return []
        copies = []
        for _ in range(2 if rng.random() < fault.duplicates else 1):
            late = fault.delay_ms + rng.uniform(0, fault.jitter_ms)
            late += _HELD_BACK_MS * (rng.random() < fault.reorder)
            broken = rng.random() < fault.corrupt
            copies.append((due + late, self._broken(datagram) if broken else datagram))
        return copies

    def _broken(self, datagram: bytes) -> bytes:
        rng = self._rng
        if rng.random() < 0.2:
            return datagram[: rng.integers(len(datagram))]
        bits = int.from_bytes(datagram, "little")
        for bit in rng.integers(8 * len(datagram), size=rng.integers(1, 9)):
            bits ^= 1 << int(bit)
        return bits.to_bytes(len(datagram), "little")
