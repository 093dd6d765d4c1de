"""Reading a log back, one that was cut short too, and refusing what is none."""

import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

import msgspec

from rmll_gaits.errors import Failure, InputError
from rmll_onboard import mcap_records as mcap
from rmll_onboard.about import FORMAT, About
from rmll_onboard.mcap_file import COMMAND, INSIDE, METADATA, NEEDS, ORDERS, STATE, Orders
from rmll_onboard.supervisor import Request
from rmll_onboard.tick import Tick

T = TypeVar("T")
_Orders = tuple[Request | None, tuple[float, float, float], bool, bool]
"""As the end of a Tick has them"""


class FlightLog:
    """A log on the disk, read anew by each method."""

    def __init__(self, path: Path) -> None:
        """Raises InputError if the file is no log."""
        try:
            import zstandard  # noqa: F401 - what logs are packed with
        except ModuleNotFoundError as error:
            raise Failure(NEEDS.format(error.name)) from error
        self.source = path.name
        self.complete = False
        """The file has its proper end; known once all of it was read"""
        self._path = path
        self.about = self._about()

    def ticks(self) -> Iterator[Tick]:
        """All whole ticks, without the daemon's inside; raises InputError where it is damaged."""
        orders: _Orders | None = None
        datagrams: list[bytes] = []
        last = -1
        for topic, message in self._messages():
            if topic == STATE:
                datagrams.append(message.data)
            elif topic == ORDERS:
                orders = self._orders(message)
            elif topic == COMMAND:
                number = message.sequence
                if orders is None or number <= last:
                    raise InputError(f"{self.source}: tick {number} is not where it should be")
                yield Tick(number, message.time, datagrams, message.data, *orders, None)
                datagrams, last = [], number

    def rows(self, kind: type[T] = dict[str, Any]) -> Iterator[T]:
        """The daemon's inside at 50 Hz as ``kind``, a dict or a msgspec.Struct of what is wanted;
        raises InputError where it is damaged or something wanted is missing."""
        decoder = msgspec.json.Decoder(kind)
        for topic, message in self._messages():
            if topic == INSIDE:
                with self._checking(f"{INSIDE} of tick {message.sequence}"):
                    inside = decoder.decode(message.data)
                yield inside

    def _about(self) -> About:
        for opcode, body in self._records():
            if opcode == mcap.METADATA:
                with self._checking("its metadata"):
                    name, entries = mcap.metadata(body)
                    if name == METADATA:
                        return _about(entries)
        raise InputError(f"{self.source}: not a log: no {METADATA!r} entry in its metadata")

    def _messages(self) -> Iterator[tuple[str, mcap.Message]]:
        """Topics and messages, in the file's order."""
        topics: dict[int, str] = {}
        self.complete = False
        for opcode, body in self._records():
            if opcode == mcap.FOOTER:
                self.complete = True
                return
            if opcode == mcap.CHUNK:
                with self._checking("a chunk"):
                    unpacked = mcap.unpack(body)
                    content = list(mcap.records(io.BytesIO(unpacked)))
                for message in self._content(content, topics):
                    yield topics.get(message.channel, ""), message

    def _content(
        self, content: list[tuple[int, bytes]], topics: dict[int, str]
    ) -> Iterator[mcap.Message]:
        """Messages of a chunk; its channels are added to ``topics``."""
        for opcode, body in content:
            if opcode == mcap.CHANNEL:
                with self._checking("a channel"):
                    number, topic = mcap.channel(body)
                topics[number] = topic
            elif opcode == mcap.MESSAGE:
                with self._checking("a message"):
                    message = mcap.message(body)
                yield message

    def _records(self) -> Iterator[tuple[int, bytes]]:
        with self._open() as file:
            if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
                raise InputError(f"{self.source}: not an MCAP file")
            found = mcap.records(file)
            while True:
                with self._checking("a record"):
                    record = next(found, None)
                if record is None:
                    return
                yield record

    def _orders(self, message: mcap.Message) -> _Orders:
        with self._checking(f"{ORDERS} of tick {message.sequence}"):
            orders = msgspec.json.decode(message.data, type=Orders)
            request = Request(orders.request) if orders.request else None
        command = orders.vx, orders.wz, orders.frequency
        return request, command, orders.by_remote, orders.stopping

    @contextmanager
    def _open(self) -> Iterator[IO[bytes]]:
        try:
            with self._path.open("rb") as file:
                yield file
        except OSError as error:
            raise InputError(f"{self._path}: {error.strerror}") from error

    @contextmanager
    def _checking(self, what: str) -> Iterator[None]:
        """Whatever is wrong with ``what`` becomes one line."""
        try:
            yield
        except (ValueError, struct.error, RecursionError, msgspec.MsgspecError) as error:
            raise InputError(f"{self.source}: {what} cannot be read: {error}") from error


def _about(entries: dict[str, str]) -> About:
    plain = {name: msgspec.json.decode(text) for name, text in entries.items()}
    if plain.get("format") != FORMAT:
        raise ValueError(f"format {plain.get('format')!r}, this rmll reads {FORMAT}")
    return msgspec.convert(plain, About)
