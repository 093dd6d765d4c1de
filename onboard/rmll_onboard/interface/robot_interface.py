"""What the daemon knows of a robot's wire, and which of them it is.

An interface is pure: datagrams in, states and datagrams out. A transport carries the datagrams.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from rmll_onboard.control.contact_estimator import ContactEstimator
from rmll_onboard.interface.a1_interface import A1Interface
from rmll_onboard.interface.can_interface import CanInterface
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.interface.transport import Transport, UdpTransport
from rmll_onboard.protocol import mit_packets
from rmll_onboard.settings.runtime_settings import Feet, RuntimeSettings
from rmll_onboard.state.packet_errors import Reason
from rmll_onboard.state.robot_state import MotorCommand, RobotState, Streams
from rmll_robots import Robot


class RobotInterface(Protocol):
    """One robot's datagrams, in both directions."""

    state: RobotState
    """The newest one that was accepted, overwritten by the next"""
    streams: Streams
    """Which measurements its states bring"""
    tick_seconds: float
    """[s] of a count of the state's clock"""
    farewell: float
    """[s] of damping datagrams at the end"""
    fault: str | None
    """What the wire itself knows to be wrong with the robot"""
    received: int
    """States that were accepted"""
    lost: int
    """Calls of :meth:`take` that brought no new state, after the first one"""
    refused: Counter[Reason]
    only_broken: bool
    """The last call brought datagrams, but none of them was whole"""
    heard: int
    """[ns] when the newest state came"""
    changed: int
    """[ns] when a state last measured anything else than the one before"""

    @property
    def missing(self) -> str:
        """Who has not been heard yet, where several have to be."""
        ...

    @property
    def rejected(self) -> int:
        """Datagrams that were broken or of another time."""
        ...

    @property
    def refusals(self) -> str:
        """How many datagrams were refused, and why."""
        ...

    def take(self, now: int, datagrams: Sequence[bytes], resting: bool) -> bool:
        """Look for a new state among ``datagrams``, in the order in which they came.

        Args:
            now: [ns], monotonic.
            datagrams: those since the last call.
            resting: no joint moves, so the board may have been started again.

        Returns whether there is a new state. Never raises.
        """
        ...

    def encode(self, command: MotorCommand) -> bytes:
        """The datagram for a command."""
        ...

    def opening(self) -> bytes | None:
        """What to send in place of the next command, to a robot that has to be switched on."""
        ...

    def contact_estimator(self, feet: Feet) -> ContactEstimator:
        """What tells contacts from this robot's states."""
        ...


def open_interface(settings: RuntimeSettings, robot: Robot) -> RobotInterface:
    """The one of the settings.

    Raises InputError if the actuators of the settings do not fit the robot.
    """
    if settings.link.kind == "udp":
        return A1Interface(settings.link, robot)
    return CanInterface(settings.can, robot)


def open_transport(settings: RuntimeSettings, robot: Robot) -> Transport:
    """What carries its datagrams. On CAN, the last that actuators hear is to switch themselves off.

    Raises InputError for wrong settings, Failure for a wire that cannot be opened.
    """
    if settings.link.kind == "udp":
        return UdpTransport(settings.link.robot_address, settings.link.local_port)
    layout = Layout(settings.can, robot)
    parting = layout.frames([mit_packets.EXIT] * len(layout.joints))
    return CanTransport(settings.can.buses, layout.answers(), parting)
