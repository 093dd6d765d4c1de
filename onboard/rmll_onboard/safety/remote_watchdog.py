"""Is the wireless remote still there? What the robot says of it when it is not, nobody published.

So it is lost if it does what a resting one cannot. All forty bytes are zero, although those that no
hand moves were not: a resting remote keeps them. Or a stick or a button is held, and not a bit has
trembled for longer than a hand can hold it. A remote that nobody touches may send the same bytes
for ever, whatever they are.
"""

from rmll_onboard.protocol import a1_remote
from rmll_onboard.settings.runtime_settings import Safety

_NOTHING = bytes(a1_remote.LENGTH)
_HEAD, _UNUSED = slice(0, 2), slice(24, a1_remote.LENGTH)


class RemoteWatchdog:
    """Watches the remote's bytes."""

    def __init__(self, safety: Safety, deadband: float) -> None:
        """``deadband``: share of a stick's way within which nobody holds it."""
        self._lost_ns = int(safety.remote_lost_ms * 1e6)
        self._still_ns = int(safety.remote_still * 1e9)
        self._deadband = deadband
        self._before = _NOTHING
        self._changed = 0
        self._held = False
        self._signed = False
        """Bytes that no hand moves were not zero: this robot's remote has them so"""

    def lost(self, now: int, data: bytes) -> bool:
        """``data``: the remote's forty bytes as they are at ``now`` [ns], its sticks finite."""
        if data != self._before:
            self._before, self._changed = data, now
            self._held = a1_remote.decode(data).held(self._deadband)
            self._signed = self._signed or any(data[_HEAD]) or any(data[_UNUSED])
        unchanged = now - self._changed
        if self._held:
            return unchanged > self._still_ns
        return self._signed and unchanged > self._lost_ns and data == _NOTHING
