"""Which language the robot speaks: the datagrams of an A1, or those of actuators on CAN."""

from collections.abc import Callable

from rmll_onboard import mit_wire
from rmll_onboard.a1_wire import CommandEncoder, MotorCommand
from rmll_onboard.can_layout import Layout
from rmll_onboard.can_link import CanLink
from rmll_onboard.can_wire import CanWire
from rmll_onboard.intake import Intake
from rmll_onboard.link import Link, UdpLink
from rmll_onboard.settings import Settings
from rmll_robots import Robot

Encode = Callable[[MotorCommand], bytes]


def open_wire(settings: Settings, robot: Robot) -> tuple[Intake, Encode]:
    """What believes the robot's datagrams, and what makes those for it.

    Raises InputError if the actuators of the settings do not fit the robot.
    """
    if settings.link.kind == "udp":
        return Intake(settings.link), CommandEncoder().encode
    wire = CanWire(settings.link, settings.can, robot)
    return wire, wire.encode


def open_link(settings: Settings, robot: Robot) -> Link:
    """What carries them. On CAN, the last that the actuators hear is to switch themselves off.

    Raises InputError for wrong settings, Failure for a wire that cannot be opened.
    """
    if settings.link.kind == "udp":
        return UdpLink(settings.link.robot_address, settings.link.local_port)
    layout = Layout(settings.can, robot)
    parting = layout.frames([mit_wire.EXIT] * len(layout.joints))
    return CanLink(settings.can.buses, layout.answers(), parting)
