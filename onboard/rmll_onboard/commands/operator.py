"""Who says what the robot should do: the wireless remote, or the flags of the command line.

A gamepad and a local socket lead too, see :mod:`gamepad` and :mod:`command_socket`.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from rmll_common.errors import InputError
from rmll_common.flag import within
from rmll_gaits.table import Commands, nearest
from rmll_onboard.protocol.a1_remote import Button, Remote, past
from rmll_onboard.state.modes import NS, Mode, Request

SECONDS = 0.02, 1e6
"""[s] that a walk may take: from a policy step to twelve days"""


class OperatorCommand(NamedTuple):
    """An operator's wish at one instant."""

    request: Request | None
    command: tuple[float, float, float]
    """vx [m/s], wz [rad/s], c_f [policy steps]"""


class Operator(Protocol):
    @property
    def by_remote(self) -> bool:
        """It is the wireless remote that leads, so losing it matters."""
        ...

    @property
    def complaint(self) -> str | None:
        """What is wrong with whoever leads, for the report."""
        ...

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        """What to do at ``now`` [ns], given the robot's mode and its remote."""
        ...

    def finished(self, mode: Mode, fault: str | None) -> bool:
        """Nothing is left to be done: the program may end."""
        ...


class RemoteOperator:
    """The person with the remote.

    START stands the robot up, A walks, B ends the walk, SELECT sits down. A stick at its end is
    the fastest that was trained; within its deadband it counts as released. UP takes a policy step
    off c_f, the steps get faster; DOWN adds one.
    """

    by_remote = True
    complaint = None

    def __init__(self, commands: Commands, frequency: float, deadband: float) -> None:
        """``frequency`` is c_f at first; ``deadband`` a share of a stick's way."""
        self._commands = commands
        self._frequency = frequency
        self._deadband = deadband
        self._held = Button.NONE

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        vx = _scaled(past(remote.forward, self._deadband), self._commands.vx)
        wz = _scaled(past(remote.turn, self._deadband), self._commands.wz)
        pushed = remote.buttons & ~self._held
        self._held = remote.buttons
        low, high = self._commands.frequency
        change = (Button.DOWN in pushed) - (Button.UP in pushed)
        self._frequency = min(high, max(low, self._frequency + change))
        return OperatorCommand(self._request(mode, remote.buttons), (vx, wz, self._frequency))

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return False

    def _request(self, mode: Mode, buttons: Button) -> Request | None:
        if Button.SELECT in buttons:
            return Request.SIT
        if mode is Mode.DAMPING:
            return Request.STAND if Button.START in buttons else None
        if Button.B in buttons:
            return Request.STAND
        return Request.WALK if Button.A in buttons else None


class FlagOperator:
    """Stands up, walks with one command for ``seconds`` (None: until stopped), sits down.

    With several values of ``frequency`` the walk goes through them, each for an equal share of
    the seconds. Raises InputError, which names the flag, for what ``commands`` does not allow.
    """

    by_remote = False
    complaint = None

    def __init__(
        self,
        commands: Commands,
        vx: float | None = None,
        wz: float | None = None,
        frequency: float | Sequence[float] | None = None,
        seconds: float | None = None,
    ) -> None:
        # a gait that always turns, or never stands, has no 0 among its commands
        vx = nearest(0.0, commands.vx) if vx is None else vx
        wz = nearest(0.0, commands.wz) if wz is None else wz
        if isinstance(frequency, int | float):
            frequency = (frequency,)
        self.vx, self.wz = vx, wz
        """[m/s], [rad/s]"""
        self.frequencies = tuple(frequency or (commands.middle_frequency,))
        """c_f [policy steps]"""
        self.seconds = seconds
        asked = [("vx", vx), ("wz", wz), *(("frequency", value) for value in self.frequencies)]
        for name, value in asked:
            low, high = getattr(commands, name)
            if not low <= value <= high:
                raise InputError(
                    f"--{name} {value:g}: this gait was trained for {low:g} to {high:g}"
                )
        if seconds is not None:
            within("seconds", seconds, *SECONDS)
        if seconds is None and len(self.frequencies) > 1:
            raise InputError("--frequency with several values needs --seconds to share out")
        self._walking_since: int | None = None

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        if mode is Mode.WALKING and self._walking_since is None:
            self._walking_since = now
        if self._walking_since is None:
            request = {Mode.DAMPING: Request.STAND, Mode.STANDING: Request.WALK}.get(mode)
            return OperatorCommand(request, (self.vx, self.wz, self.frequencies[0]))
        done = 0.0 if self.seconds is None else (now - self._walking_since) / (self.seconds * NS)
        request = Request.SIT if done >= 1 else None
        which = min(int(done * len(self.frequencies)), len(self.frequencies) - 1)
        return OperatorCommand(request, (self.vx, self.wz, self.frequencies[which]))

    def finished(self, mode: Mode, fault: str | None) -> bool:
        walked = self._walking_since is not None
        return fault is not None or (walked and mode is Mode.DAMPING)


def _scaled(share: float, limits: tuple[float, float]) -> float:
    low, high = limits
    return share * (high if share > 0 else -low)
