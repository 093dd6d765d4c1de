"""The A1's board: which of its datagrams are believed, and the commands for it.

A checksum proves that a datagram is whole, not that it is new: the network delays, doubles and
overtakes, and somebody may send old datagrams again. The board's own clock, the tick, decides.
"""

from collections.abc import Sequence

from rmll_onboard.control.contact_estimator import ContactEstimator
from rmll_onboard.interface.packet_counter import PacketCounter
from rmll_onboard.protocol.a1_packets import CommandEncoder, StateDecoder, check_state, peek_tick
from rmll_onboard.settings.runtime_settings import Feet, LinkSettings
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import MotorCommand, Streams
from rmll_robots import Robot

BROKEN = frozenset({Reason.LENGTH, Reason.LEVEL, Reason.CRC, Reason.NOT_FINITE})
"""What no sane network or board delivers; late and repeated datagrams are ordinary"""

_MEASURED = slice(10, 719)
"""Bytes of a LowState between its header and its tick: all that is measured, but the remote"""
_RESTART_NS = 200_000_000
"""A board that starts again counts from zero: then nothing but old ticks comes for so long"""
_SLACK_NS = 1_000_000_000
"""The board's clock may be so far ahead of what our own clock says"""


class A1Interface(PacketCounter):
    """An A1's board on UDP."""

    fault: str | None = None
    missing = ""
    streams = Streams(accelerometer=True, rpy=True, feet=True)
    farewell = 0.5
    """The board then brakes by itself"""

    def __init__(self, link: LinkSettings, robot: Robot) -> None:
        self._robot = robot
        self._decoder = StateDecoder()
        super().__init__(self._decoder.state)
        self._tick: int | None = None
        self._tick_ns = link.tick_us * 1000
        self.tick_seconds = link.tick_us * 1e-6
        self._encoder = CommandEncoder()

    def contact_estimator(self, feet: Feet) -> ContactEstimator:
        """By foot sensors once they are learnt, by torques until then."""
        return ContactEstimator(feet, self._robot, sensors=True)

    @property
    def rejected(self) -> int:
        """Datagrams that were broken or of another time."""
        return self.refused.total() - self.refused[Reason.REPEATED] - self.refused[Reason.LATE]

    def encode(self, command: MotorCommand) -> bytes:
        return self._encoder.encode(command)

    def opening(self) -> bytes | None:
        return None

    def take(self, now: int, datagrams: Sequence[bytes], resting: bool) -> bool:
        """Look for a new state among ``datagrams``, in the order in which they came.

        Args:
            now: [ns], monotonic.
            datagrams: those since the last call; the ones older than the newest good one are
                not looked at.
            resting: no joint moves, so the board may have been started again.

        Returns whether there is a new state.
        """
        if resting and now - self.heard > _RESTART_NS:
            self._tick = None
        fresh = whole = False
        for datagram in self._newest_first(datagrams):
            try:
                self._accept(now, datagram)
            except BadPacket as bad:
                self.refused[bad.reason] += 1
                whole = whole or bad.reason not in BROKEN
            else:
                fresh = True
                break
        self.only_broken = bool(datagrams) and not (fresh or whole)
        self.lost += not fresh and self.received > 0
        return fresh

    def _newest_first(self, datagrams: Sequence[bytes]) -> Sequence[bytes]:
        if len(datagrams) < 2:
            return datagrams
        # stable, so that among equals the one that came last is first
        return sorted(datagrams, key=self._ahead)[::-1]

    def _ahead(self, datagram: bytes) -> int:
        """Ticks after the newest state, negative before it; the tick is 32 bits and wraps."""
        if self._tick is None:
            return 0
        return (peek_tick(datagram) - self._tick + 0x80000000 & 0xFFFFFFFF) - 0x80000000

    def _accept(self, now: int, datagram: bytes) -> None:
        """Take the state; raises BadPacket."""
        if self._tick is not None:
            self._check_order(now, datagram)
        self._decoder.decode(datagram)
        self._accepted(now, datagram[_MEASURED])
        self._tick = self.state.tick

    def _check_order(self, now: int, datagram: bytes) -> None:
        ahead = self._ahead(datagram)
        if 0 < ahead * self._tick_ns <= now - self.heard + _SLACK_NS:
            return
        check_state(datagram)  # one that is broken besides is called broken
        if ahead == 0:
            raise BadPacket(Reason.REPEATED)
        raise BadPacket(Reason.LATE if ahead < 0 else Reason.AHEAD)
