"""Reading a log back, one that was cut short too, and refusing what is none."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, TypeVar

import msgspec

from rmll_common.errors import Failure, InputError
from rmll_onboard.recording import mcap_reader
from rmll_onboard.recording.log_metadata import FORMAT, LogMetadata
from rmll_onboard.recording.mcap_writer import (
    COMMAND,
    INSIDE,
    METADATA,
    NEEDS,
    ORDERS,
    STATE,
    OperatorRecord,
)
from rmll_onboard.recording.telemetry import TelemetryRow, Tick, row_type
from rmll_onboard.state.modes import NS, Request

if TYPE_CHECKING:  # the base install has no logs
    from mcap.records import Message

Row = TypeVar("Row", bound=msgspec.Struct)
SHOWN = 6
"""Gaps that are told one by one"""
_Orders = tuple[Request | None, tuple[float, float, float], bool, bool]
"""As the end of a Tick has them"""
_UNTOLD: _Orders = (None, (math.nan, math.nan, math.nan), False, False)


@dataclass(frozen=True)
class Gap:
    """Ticks that are not in a log: lost with a damaged chunk, or never kept."""

    first: int
    last: int | None
    """None if nothing follows"""
    start: float
    """[s] since the log's beginning, of the last tick before it"""
    end: float | None
    """The same of the first tick after it"""

    def __str__(self) -> str:
        if self.last is None or self.end is None:
            return f"tick {self.first} and on, from {self.start:.3f} s"
        which = "" if self.last == self.first else f" to {self.last}"
        return f"tick {self.first}{which}, {self.start:.3f} to {self.end:.3f} s"


def missing(gaps: Sequence[Gap], lost: int | None) -> list[str]:
    """Lines about what is not in a log, for the user; none where nothing is missing."""
    lines = [f"missing in the log: {gap}" for gap in gaps[:SHOWN]]
    if more := len(gaps) - len(lines):
        lines.append(f"and {more} more gaps")
    if lost:
        lines.append(f"messages that cannot be read: {lost}")
    return lines


class _Counts:
    """Looks for gaps in the ticks of a log that is read."""

    def __init__(self, control_hz: int) -> None:
        self.messages = 0
        self._gaps: list[Gap] = []
        self._period = NS / control_hz
        self._lost = False
        """There was something since the last tick"""
        self._last, self._began, self._now = -1, 0.0, 0.0

    def loss(self) -> None:
        self._lost = True

    def message(self, message: "Message", whole: bool) -> None:
        """``whole``: with it, its tick is."""
        self.messages += 1
        if not whole:
            return
        if self._last < 0:
            self._began = self._now = message.log_time - message.sequence * self._period
        before, self._now = self._seconds(), message.log_time
        if message.sequence > self._last + 1 and (self._last >= 0 or self._lost):
            gap = Gap(self._last + 1, message.sequence - 1, before, self._seconds())
            self._gaps.append(gap)
        self._last, self._lost = message.sequence, False

    def all_gaps(self) -> list[Gap]:
        """With that at the end, if something is lost there."""
        if not self._lost:
            return self._gaps
        return [*self._gaps, Gap(self._last + 1, None, self._seconds(), None)]

    def _seconds(self) -> float:
        return (self._now - self._began) / NS


class FlightLog:
    """A log on the disk, read anew by each method. A damaged chunk costs what is in it alone."""

    def __init__(self, path: Path) -> None:
        """Raises InputError if the file is no log."""
        try:
            import mcap.records  # noqa: F401 - and what logs are packed with
        except ModuleNotFoundError as error:
            raise Failure(NEEDS.format(error.name)) from error
        self.source = path.name
        # known once all of it was read
        self.complete = False
        """The file has its proper end"""
        self.gaps: list[Gap] = []
        self.lost: int | None = None
        """Messages that were there and cannot be read; None if the file does not tell"""
        self._path = path
        self.about = self._metadata()

    def ticks(self) -> Iterator[Tick]:
        """All whole ticks, without the daemon's inside; raises InputError for a strange one.

        After a damaged chunk the orders are NaN and none until they are told again.
        """
        orders: _Orders | None = None
        datagrams: list[bytes] = []
        last = -1
        for topic, message in self._messages():
            if message is None:
                orders, datagrams = _UNTOLD, []
            elif topic == STATE:
                datagrams.append(message.data)
            elif topic == ORDERS:
                orders = self._orders(message)
            elif topic == COMMAND:
                number = message.sequence
                if orders is None or number <= last:
                    raise InputError(f"{self.source}: tick {number} is not where it should be")
                yield Tick(number, message.log_time, datagrams, message.data, *orders, None)
                datagrams, last = [], number

    def rows(self) -> Iterator[TelemetryRow]:
        """The daemon's inside at 50 Hz, as :func:`rmll_onboard.recording.telemetry.row` has it.

        Raises InputError where it is damaged or a column is missing.
        """
        with self._checking("the names of its columns"):
            kind = row_type(self.about.columns)
        yield from self.rows_of(kind)

    def rows_of(self, kind: type[Row]) -> Iterator[Row]:
        """The same as a ``kind`` that has what is wanted and no more."""
        decoder = msgspec.json.Decoder(kind)
        for topic, message in self._messages():
            if message is not None and topic == INSIDE:
                with self._checking(f"{INSIDE} of tick {message.sequence}"):
                    inside = decoder.decode(message.data)
                yield inside

    def _metadata(self) -> LogMetadata:
        with self._open() as file:
            if file.read(len(mcap_reader.MAGIC)) != mcap_reader.MAGIC:
                raise InputError(f"{self.source}: not an MCAP file")
            for opcode, body in mcap_reader.records(file):
                if opcode == mcap_reader.METADATA:
                    with self._checking("its metadata"):
                        name, entries = mcap_reader.metadata(body)
                        if name == METADATA:
                            return _metadata(entries)
        raise InputError(f"{self.source}: not a log: no {METADATA!r} entry in its metadata")

    def _messages(self) -> "Iterator[tuple[str, Message | None]]":
        """Topics and messages in the file's order, and a None where some are lost.

        The first command after that is left out: its tick may lack datagrams.
        """
        from mcap.records import Channel, Message

        with self._open() as file:
            summary = mcap_reader.summary(file)
            topics = {channel.id: channel.topic for channel in summary.channels} if summary else {}
            seen = _Counts(self.about.control_hz)
            why, is_partial = "", False
            for content in mcap_reader.chunks(file, summary.chunks if summary else ()):
                if isinstance(content, mcap_reader.Lost):
                    why, is_partial = content.why, True
                    seen.loss()
                    yield "", None
                    continue
                for record in content:
                    if isinstance(record, Channel):
                        topics[record.id] = record.topic
                    elif isinstance(record, Message):
                        topic = topics.get(record.channel_id, "")
                        is_command = topic == COMMAND
                        seen.message(record, is_command and not is_partial)
                        if not (is_command and is_partial):
                            yield topic, record
                        is_partial &= not is_command
            if why and not seen.messages:
                raise InputError(f"{self.source}: no chunk of it can be read: {why}")
            self.gaps = seen.all_gaps()
            self.complete = summary is not None
            there = summary.messages if summary else None
            self.lost = None if there is None else max(there - seen.messages, 0)

    def _orders(self, message: "Message") -> _Orders:
        with self._checking(f"{ORDERS} of tick {message.sequence}"):
            orders = msgspec.json.decode(message.data, type=OperatorRecord)
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
        except (ValueError, RecursionError, msgspec.MsgspecError) as error:
            raise InputError(f"{self.source}: {what} cannot be read: {error}") from error


def _metadata(entries: dict[str, str]) -> LogMetadata:
    plain = {name: msgspec.json.decode(text) for name, text in entries.items()}
    if plain.get("format") != FORMAT:
        raise ValueError(f"format {plain.get('format')!r}, this rmll reads {FORMAT}")
    return msgspec.convert(plain, LogMetadata)
