"""A robot that meets one fault of the table, and notes what the daemon tells it to do about it.

Whether time is real or virtual is none of its business: it counts the robot's milliseconds.
"""

import signal
from collections.abc import Iterator

import msgspec
import numpy as np

from rmll_hil.faults.fault_rows import BEGIN, FaultRow, Reaction
from rmll_hil.robot.a1_board_packets import A1BoardPackets
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.fault_plan import Plan, parse_plan
from rmll_onboard.state.reports import DaemonReport
from rmll_robots import Robot

MOTION = {"crouch": 0.3, "rise": 0.6, "settle": 0.2, "slow_down": 0.3, "sit": 0.3}
"""[s] of the daemon's movements: brisk, all else is as it comes"""
VX = 0.4
"""[m/s]"""
WALKED_MS = 1000
"""The fault begins when the robot has walked for so long"""
STANDS_UP_MS = 8000
"""Time for it to begin to walk"""
WATCHED_MS = 3000
"""How long a fault is given to show an effect; a stuck gait, the slowest, takes two seconds"""
SETTLED_MS = 500
"""A reaction that came stays for so long"""
_BOARD = A1BoardPackets()


class FaultTrial(Emulator):
    """The robot of one row."""

    def __init__(self, row: FaultRow, robot: Robot, seed: int) -> None:
        self.begin_ms: int | None = None
        """When the fault begins; None until the robot walks"""
        self.found: tuple[Reaction, int | None] | None = None
        """What it was told to do instead of walking on, and how many milliseconds after the
        fault; None while there is more to be seen"""
        self._told: list[tuple[int, Reaction]] = []
        """Robot's time [ms] and what it was told, whenever that changed"""
        self._plan: Plan = parse_plan(row.plan, robot)
        self._signals = [(after, signal.Signals[name]) for after, name in row.signals]
        self._provoked = self._terminated = False
        super().__init__(EmulatorSettings(seed=seed), robot=robot, plan=_before(self._plan))

    def receive(self, datagram: bytes) -> bool:
        good = super().receive(datagram)
        if good:
            self._note(self._kind(datagram))
        return good

    def advance(self, milliseconds: int, time_ns: int) -> None:
        super().advance(milliseconds, time_ns)
        if self._told and not self.board.mode.any():
            self._note(Reaction.BRAKES)
        if self.begin_ms is not None and not self._provoked and self.now_ms >= self.begin_ms:
            self.follow(_later(self._plan, self.now_ms / 1000 - BEGIN))
            self._provoked = True
        if self.found is None and self._seen_enough():
            self.found = self.reaction()

    def signals(self) -> Iterator[signal.Signals]:
        """What the daemon is to be sent now: the row's, each at its time, and one to end."""
        if self.begin_ms is not None:
            while self._signals and self.now_ms >= self.begin_ms + self._signals[0][0] * 1000:
                yield self._signals.pop(0)[1]
        if self.found is not None and not self._terminated:
            self._terminated = True
            yield signal.SIGTERM

    def _note(self, kind: Reaction) -> None:
        if not self._told or self._told[-1][1] is not kind:
            self._told.append((self.now_ms, kind))
        if self._provoked:
            return
        if kind is not Reaction.WALKS:
            self.begin_ms = None  # a machine that is held up interrupts the walk before the fault
        elif self.begin_ms is None:
            self.begin_ms = self.now_ms + WALKED_MS

    def _kind(self, datagram: bytes) -> Reaction:
        command = _BOARD.decode_command(datagram)
        if not command.kp.any():
            return Reaction.DAMPS
        if command.kp[0] == self._robot.kp:
            return Reaction.WALKS
        folded = np.abs(command.q - self._robot.crouch_pose).max() < 0.1
        return Reaction.SITS if folded else Reaction.STANDS

    def _seen_enough(self) -> bool:
        if self.begin_ms is None:
            return self.now_ms > STANDS_UP_MS
        if self._signals:
            return False
        _, after_ms = self.reaction()
        until = WATCHED_MS if after_ms is None else after_ms + SETTLED_MS
        return self.now_ms - self.begin_ms > until

    def reaction(self) -> tuple[Reaction, int | None]:
        """What it was told so far to do instead of walking on, or of standing up, and when [ms]."""
        begin = self.begin_ms
        if begin is None:
            return self._before_walking()
        before = [kind for at, kind in self._told if at < begin]
        after = [(at - begin, kind) for at, kind in self._told if at >= begin]
        if before[-1] is not Reaction.WALKS:
            return Reaction.NEVER_WALKED, None
        if not after:
            return Reaction.WALKS, None
        at, first = after[0]
        # sitting down begins in the pose of standing
        folds = first is Reaction.STANDS and any(kind is Reaction.SITS for _, kind in after)
        return (Reaction.SITS if folds else first), at

    def _before_walking(self) -> tuple[Reaction, int | None]:
        # after its daemon has ended, the board brakes
        told = [(at, kind) for at, kind in self._told if kind is not Reaction.BRAKES]
        if any(fault.at >= BEGIN for fault in self._plan) or not told:
            return Reaction.NEVER_WALKED, None
        if all(kind is Reaction.DAMPS for _, kind in told):
            return Reaction.REFUSES, None
        at, last = told[-1]
        return (Reaction.DAMPS, at) if last is Reaction.DAMPS else (Reaction.NEVER_WALKED, None)


def words(report: DaemonReport) -> str:
    """The fault of a daemon, its name first, or its warnings."""
    if report.fault:
        return f"{report.fault_name}: {report.fault}"
    return "; ".join(report.warnings)


def _before(plan: Plan) -> Plan:
    """While its fault is still to come: what there is from before it, for as long as it takes."""
    return tuple(
        msgspec.structs.replace(fault, seconds=None)
        if fault.seconds is not None and fault.at + fault.seconds >= BEGIN
        else fault
        for fault in plan
        if fault.at < BEGIN
    )


def _later(plan: Plan, seconds: float) -> Plan:
    """The same that much later, to the millisecond."""
    return tuple(msgspec.structs.replace(fault, at=round(fault.at + seconds, 3)) for fault in plan)
