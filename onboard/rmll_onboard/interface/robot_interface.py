"""Which language the robot speaks: the datagrams of an A1, or those of actuators on CAN."""

from collections.abc import Callable

from rmll_onboard.interface.can_interface import CanInterface
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.interface.state_receiver import StateReceiver
from rmll_onboard.interface.transport import Transport, UdpTransport
from rmll_onboard.protocol import mit_packets
from rmll_onboard.protocol.a1_packets import CommandEncoder
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.robot_state import MotorCommand
from rmll_robots import Robot

Encode = Callable[[MotorCommand], bytes]


def open_wire(settings: RuntimeSettings, robot: Robot) -> tuple[StateReceiver, Encode]:
    """What believes the robot's datagrams, and what makes those for it.

    Raises InputError if the actuators of the settings do not fit the robot.
    """
    if settings.link.kind == "udp":
        return StateReceiver(settings.link), CommandEncoder().encode
    wire = CanInterface(settings.link, settings.can, robot)
    return wire, wire.encode


def open_link(settings: RuntimeSettings, robot: Robot) -> Transport:
    """What carries them. On CAN, the last that the actuators hear is to switch themselves off.

    Raises InputError for wrong settings, Failure for a wire that cannot be opened.
    """
    if settings.link.kind == "udp":
        return UdpTransport(settings.link.robot_address, settings.link.local_port)
    layout = Layout(settings.can, robot)
    parting = layout.frames([mit_packets.EXIT] * len(layout.joints))
    return CanTransport(settings.can.buses, layout.answers(), parting)
