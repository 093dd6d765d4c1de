"""Who says what the robot should do: the wireless remote, or the flags of the command line."""

from statistics import fmean
from typing import NamedTuple, Protocol

from rmll_gaits.errors import InputError
from rmll_gaits.table import Commands
from rmll_onboard.remote import Button, Remote
from rmll_onboard.supervisor import NS, Mode, Request


class Orders(NamedTuple):
    """A pilot's wish at one instant."""

    request: Request | None
    command: tuple[float, float, float]
    """vx [m/s], wz [rad/s], c_f [policy steps]"""


class Pilot(Protocol):
    def orders(self, now: int, mode: Mode, remote: Remote) -> Orders:
        """What to do at ``now`` [ns], given the robot's mode and its remote."""
        ...

    def finished(self, mode: Mode, fault: str | None) -> bool:
        """Nothing is left to be done: the program may end."""
        ...


class RemotePilot:
    """The person with the remote.

    START stands the robot up, A walks, B ends the walk, SELECT sits down. A stick at its end is
    the fastest that was trained.
    """

    def __init__(self, commands: Commands, frequency: float) -> None:
        self._commands = commands
        self._frequency = frequency

    def orders(self, now: int, mode: Mode, remote: Remote) -> Orders:
        vx = _scaled(remote.forward, self._commands.vx)
        wz = _scaled(remote.turn, self._commands.wz)
        return Orders(self._request(mode, remote.buttons), (vx, wz, self._frequency))

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


class FlagPilot:
    """Stands up, walks with one command for ``seconds`` (None: until stopped), sits down.

    Raises InputError, which names the flag, for a command that ``commands`` does not allow.
    """

    def __init__(
        self,
        commands: Commands,
        vx: float = 0.0,
        wz: float = 0.0,
        frequency: float | None = None,
        seconds: float | None = None,
    ) -> None:
        if frequency is None:
            frequency = middle_frequency(commands)
        self.command = vx, wz, frequency
        """vx [m/s], wz [rad/s], c_f [policy steps]"""
        self.seconds = seconds
        for name, value in zip(("vx", "wz", "frequency"), self.command, strict=True):
            low, high = getattr(commands, name)
            if not low <= value <= high:
                raise InputError(
                    f"--{name} {value:g}: this gait was trained for {low:g} to {high:g}"
                )
        if seconds is not None and not seconds > 0:
            raise InputError(f"--seconds {seconds:g}: expected more than 0")
        self._walking_since: int | None = None

    def orders(self, now: int, mode: Mode, remote: Remote) -> Orders:
        if mode is Mode.WALKING and self._walking_since is None:
            self._walking_since = now
        if self._walking_since is None:
            request = {Mode.DAMPING: Request.STAND, Mode.STANDING: Request.WALK}.get(mode)
        else:
            walked = now - self._walking_since
            over = self.seconds is not None and walked >= self.seconds * NS
            request = Request.SIT if over else None
        return Orders(request, self.command)

    def finished(self, mode: Mode, fault: str | None) -> bool:
        walked = self._walking_since is not None
        return fault is not None or (walked and mode is Mode.DAMPING)


def middle_frequency(commands: Commands) -> float:
    """c_f where nobody chose one: the middle of what was trained, in whole policy steps."""
    return float(round(fmean(commands.frequency)))


def _scaled(share: float, limits: tuple[float, float]) -> float:
    low, high = limits
    return share * (high if share > 0 else -low)
