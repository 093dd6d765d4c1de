"""Which of the robot's datagrams are believed.

A checksum proves that a datagram is whole, not that it is new: the network delays, doubles and
overtakes, and somebody may send old datagrams again. The board's own clock, the tick, decides.
"""

from collections import Counter
from collections.abc import Sequence

from rmll_onboard.protocol.a1_packets import StateDecoder, check_state, peek_tick
from rmll_onboard.settings.runtime_settings import LinkSettings
from rmll_onboard.state.packet_errors import BadPacket, Reason
from rmll_onboard.state.robot_state import Streams

BROKEN = frozenset({Reason.LENGTH, Reason.LEVEL, Reason.CRC, Reason.NOT_FINITE})
"""What no sane network or board delivers; late and repeated datagrams are ordinary"""

_MEASURED = slice(10, 719)
"""Bytes of a LowState between its header and its tick: all that is measured, but the remote"""
_RESTART_NS = 200_000_000
"""A board that starts again counts from zero: then nothing but old ticks comes for so long"""
_SLACK_NS = 1_000_000_000
"""The board's clock may be so far ahead of what our own clock says"""


class StateReceiver:
    """Keeps the newest believable state, and counts the datagrams that were none."""

    fault: str | None = None
    """What the wire itself knows to be wrong with the robot: on this one, nothing"""
    missing = ""
    """Who has not been heard yet, where several have to be"""
    streams = Streams(accelerometer=True, rpy=True, feet=True)
    farewell = 0.5
    """[s] of damping datagrams at the end; the board then brakes by itself"""

    def __init__(self, link: LinkSettings) -> None:
        self._decoder = StateDecoder()
        self.state = self._decoder.state
        """The newest one, overwritten by the next"""
        self.received = 0
        """States that were believed"""
        self.lost = 0
        """Calls that brought no new state, after the first one"""
        self.refused: Counter[Reason] = Counter()
        self.only_broken = False
        """The last call brought datagrams, but none of them was whole"""
        self.heard = 0
        """[ns] when the newest state came"""
        self.changed = 0
        """[ns] when a state last measured anything else than the one before"""
        self._tick: int | None = None
        self._measured = b""
        self._tick_ns = link.tick_us * 1000
        self.tick_seconds = link.tick_us * 1e-6
        """[s] of a count of :attr:`RobotState.tick`"""

    @property
    def rejected(self) -> int:
        """Datagrams that were broken or of another time."""
        return self.refused.total() - self.refused[Reason.REPEATED] - self.refused[Reason.LATE]

    @property
    def refusals(self) -> str:
        """How many datagrams were refused, and why."""
        counts = ", ".join(f"{count} {reason}" for reason, count in self.refused.items())
        hint = "; is link.tick_us right?" if self.refused[Reason.AHEAD] > self.received else ""
        return f"refused: {counts or 'none'}{hint}"

    def opening(self) -> bytes | None:
        """What to send in place of the next command, to a robot that has to be switched on."""
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
        self.received += 1
        self.heard = now
        self._tick = self.state.tick
        measured = datagram[_MEASURED]
        if measured != self._measured:
            self._measured, self.changed = measured, now

    def _check_order(self, now: int, datagram: bytes) -> None:
        ahead = self._ahead(datagram)
        if 0 < ahead * self._tick_ns <= now - self.heard + _SLACK_NS:
            return
        check_state(datagram)  # one that is broken besides is called broken
        if ahead == 0:
            raise BadPacket(Reason.REPEATED)
        raise BadPacket(Reason.LATE if ahead < 0 else Reason.AHEAD)
