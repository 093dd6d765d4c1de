"""What every interface counts of the datagrams that came."""

from collections import Counter

from rmll_onboard.state.packet_errors import Reason
from rmll_onboard.state.robot_state import RobotState


class PacketCounter:
    """The newest state, and the datagrams that were none."""

    def __init__(self, state: RobotState) -> None:
        self.state = state
        """The newest one, overwritten by the next"""
        self.received = 0
        """States that were accepted"""
        self.lost = 0
        """Calls that brought no new state, after the first one"""
        self.refused: Counter[Reason] = Counter()
        self.only_broken = False
        """The last call brought datagrams, but none of them was whole"""
        self.heard = 0
        """[ns] when the newest state came"""
        self.changed = 0
        """[ns] when a state last measured anything else than the one before"""
        self._measured = b""

    @property
    def refusals(self) -> str:
        """How many datagrams were refused, and why."""
        counts = ", ".join(f"{count} {reason}" for reason, count in self.refused.items())
        hint = "; is link.tick_us right?" if self.refused[Reason.AHEAD] > self.received else ""
        return f"refused: {counts or 'none'}{hint}"

    def _accepted(self, now: int, measured: bytes) -> None:
        """A new state came at ``now`` [ns]; ``measured`` is all that it measured, as bytes."""
        self.received += 1
        self.heard = now
        if measured != self._measured:
            self._measured, self.changed = measured, now
