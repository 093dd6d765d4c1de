"""The buses themselves, by python-can: a datagram of frames goes out as frames, and back."""

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rmll_common.errors import Failure
from rmll_onboard.protocol.can_frame import LARGEST_ID, MOST, Frame, pack, unpack
from rmll_onboard.settings.can_settings import Bus

if TYPE_CHECKING:
    import can

_PARTINGS, _PAUSE = 3, 0.005
"""How often the last datagram is sent, and [s] after each: a bus may lose one"""


class CanTransport:
    """Several buses as one link; the daemon's side and an emulated robot's are alike.

    Error frames, remote frames, CAN FD and 29-bit identifiers are not heard; no actuator has them.
    """

    def __init__(
        self, buses: Mapping[str, Bus], heard: Sequence[Iterable[int]], parting: bytes = b""
    ) -> None:
        """``heard``: for each bus the identifiers to listen to, so that neither strangers nor our
        own frames crowd out the others. ``parting``: a datagram to be sent as the link closes,
        whatever the reason.

        Raises Failure if a bus cannot be opened or python-can is not installed.
        """
        try:
            import can
        except ModuleNotFoundError as error:
            raise Failure("python-can is not installed; run: pip install 'rmll[can]'") from error
        self.name = ", ".join(f"{bus.interface} {bus.channel}" for bus in buses.values())
        self._parting = parting
        self._message, self._error = can.Message, can.CanError
        self._heard = [frozenset(identifiers) for identifiers in heard]
        self._buses: list[can.BusABC] = []
        try:
            for (name, bus), identifiers in zip(buses.items(), self._heard, strict=True):
                self._buses.append(_open(can, name, bus, identifiers))
        except BaseException:
            self._shut()
            raise

    def send(self, datagram: bytes) -> None:
        """Send the frames; a full queue or a bus that is down counts as a loss."""
        for bus, identifier, data in unpack(datagram):
            message = self._message(arbitration_id=identifier, data=data, is_extended_id=False)
            with suppress(self._error, OSError):
                self._buses[bus].send(message)

    def receive(self) -> list[bytes]:
        """All frames that came since the last call as one datagram, [] if none did."""
        most = MOST // len(self._buses)
        frames = [
            frame
            for number, bus in enumerate(self._buses)
            for frame in self._drain(number, bus, most)
        ]
        return [pack(frames)] if frames else []

    def close(self) -> None:
        for _ in range(_PARTINGS if self._parting else 0):
            self.send(self._parting)
            time.sleep(_PAUSE)
        self._shut()

    def _drain(self, number: int, bus: "can.BusABC", most: int) -> list[Frame]:
        frames, heard = [], self._heard[number]
        with suppress(self._error, OSError):  # a bus that is down
            for _ in range(most):
                message = bus.recv(0)
                if message is None:
                    break
                if message.arbitration_id in heard and _is_plain(message):
                    frames.append(Frame(number, message.arbitration_id, bytes(message.data)))
        return frames

    def _shut(self) -> None:
        for bus in self._buses:
            bus.shutdown()


def _open(can: Any, name: str, bus: Bus, heard: Iterable[int]) -> "can.BusABC":
    options: dict[str, Any] = {"bitrate": bus.bitrate}
    if bus.interface == "udp_multicast":
        # no hop: not a packet of it leaves the machine
        options = {"port": bus.port, "hop_limit": 0}
    if bus.interface == "socketcan":
        # the kernel filters; python-can itself would take a frame that it filters for an empty bus
        filters = [{"can_id": one, "can_mask": LARGEST_ID, "extended": False} for one in heard]
        options = {"can_filters": filters}
    try:
        return can.Bus(
            interface=bus.interface,
            channel=bus.channel,
            ignore_config=True,  # python-can's own configuration files have no say
            **options,
        )
    except Exception as error:  # each of its back ends has exceptions of its own
        why = getattr(error, "strerror", None) or error
        raise Failure(f"bus {name}: {bus.interface} {bus.channel}: {why}") from error


def _is_plain(message: "can.Message") -> bool:
    special = message.is_error_frame or message.is_remote_frame or message.is_fd
    return not (special or message.is_extended_id) and len(message.data) <= 8
