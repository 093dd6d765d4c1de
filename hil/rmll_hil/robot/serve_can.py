"""The emulator as a process of its own, in real time, on CAN buses."""

import socket
import time
from contextlib import ExitStack

from msgspec.structs import replace

from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.serve import LARGEST_LAG_NS, PERIOD_MS, PERIOD_NS, Stop
from rmll_onboard.interface.transport import Transport
from rmll_onboard.settings.can_settings import Can


def serve_can(emulator: Emulator, link: Transport, stop: Stop) -> float:
    """Run until ``stop``; returns the robot's time over the wall's, from the first command on.

    No time passes before a first command. The buses are looked at every 2 ms, so answers take up to
    that long; a real actuator's take a tenth of it.
    """
    started = deadline = time.monotonic_ns()
    while not stop.wanted:
        deadline += PERIOD_NS
        time.sleep(max(0, deadline - time.monotonic_ns()) * 1e-9)
        for datagram in link.receive():
            emulator.receive(datagram)
        if not emulator.accepted:
            started = deadline
            continue
        link.send(emulator.state_datagram())
        emulator.advance(PERIOD_MS, deadline)
        if time.monotonic_ns() - deadline > LARGEST_LAG_NS:
            deadline = time.monotonic_ns()
    return emulator.now_ms * 1e6 / max(time.monotonic_ns() - started, 1)


def on_free_ports(can: Can) -> Can:
    """The same robot where nobody else's frames are: udp_multicast tells its buses by the port."""
    buses = dict(can.buses)
    with ExitStack() as taken:  # until all have one, so that no port is given twice
        for name, bus in can.buses.items():
            if bus.interface == "udp_multicast":
                sock = taken.enter_context(socket.socket(socket.AF_INET6, socket.SOCK_DGRAM))
                sock.bind(("::1", 0))
                buses[name] = replace(bus, port=sock.getsockname()[1])
    return replace(can, buses=buses)
