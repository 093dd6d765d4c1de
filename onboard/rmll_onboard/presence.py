"""Is the wireless remote still there? What the robot says of it when it is not, nobody published.

So both likely cases count as lost: all forty bytes are zero, after they were not; and a stick or
a button that is held has not trembled for longer than a hand can hold it.
"""

from rmll_onboard import remote
from rmll_onboard.settings import Safety

_NOTHING = bytes(remote.LENGTH)
_HEAD = slice(0, 2)


class Presence:
    """Watches the remote's bytes."""

    def __init__(self, safety: Safety) -> None:
        self._lost_ns = int(safety.remote_lost_ms * 1e6)
        self._still_ns = int(safety.remote_still * 1e9)
        self._before = _NOTHING
        self._changed = 0
        self._has_head = False

    def lost(self, now: int, data: bytes) -> bool:
        """``data``: the remote's forty bytes as they are at ``now`` [ns]."""
        if data != self._before:
            self._before, self._changed = data, now
        # robots that fill the head do so as long as there is a remote, with its sticks released too
        self._has_head = self._has_head or any(data[_HEAD])
        unchanged = now - self._changed
        if data == _NOTHING:
            return self._has_head and unchanged > self._lost_ns
        held = any(data[_HEAD.stop :])
        return held and unchanged > self._still_ns
