"""A log as a file: MCAP, which Foxglove and PlotJuggler open.

=================== ======== =============================================================
topic               encoding holds
=================== ======== =============================================================
/state_datagram     raw      what came from the robot, none or more a tick
/command_datagram   raw      what was sent, one a tick; the tick is whole when it is there
/orders             JSON     what the operator wants, whenever that changes
/inside             JSON     the daemon's inside at 50 Hz
=================== ======== =============================================================

A message's sequence is the number of its tick and its time the tick's, on the monotonic clock. What
the log says about itself is the metadata record ``rmll``, each value as JSON.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import msgspec

from rmll_common.errors import Failure
from rmll_gaits.label import FEET
from rmll_onboard.recording.log_metadata import LogMetadata
from rmll_onboard.recording.telemetry import Tick, row, row_type

METADATA = "rmll"
STATE, COMMAND, ORDERS, INSIDE = "/state_datagram", "/command_datagram", "/orders", "/inside"
RAW = "application/octet-stream"
NEEDS = "logs: {} is not installed; run: pip install 'rmll[record]'"
"""What to say when a library is missing"""

_TEXT, _INTEGER, _NUMBER = {"type": "string"}, {"type": "integer"}, {"type": ["number", "null"]}
SCHEMA = {
    "t_ns": _INTEGER | {"description": "[ns], monotonic"},
    "mode": _TEXT | {"description": "of the supervisor"},
    "fault": _TEXT | {"description": "empty without one"},
    "label": _INTEGER | {"description": "feet in contact as bits: FR 1, FL 2, RR 4, RL 8"},
    **{f"down_{foot}": _INTEGER | {"description": "1 in contact"} for foot in FEET},
    "state": _TEXT | {"description": "of the automaton"},
    "phi": _INTEGER | {"description": "policy steps since the last transition"},
    "advanced": _INTEGER | {"description": "1 if a transition was taken"},
    "off_spec": _INTEGER | {"description": "1 if the automaton does not explain the label"},
    "vx": _NUMBER | {"description": "[m/s], as used"},
    "wz": _NUMBER | {"description": "[rad/s], as used"},
    "frequency": _NUMBER | {"description": "c_f [policy steps], as used"},
}
"""Of a row's fixed columns, in JSON Schema"""
_ORDERS = {
    "request": _TEXT | {"description": "empty without one"},
    "vx": _NUMBER | {"description": "[m/s]"},
    "wz": _NUMBER | {"description": "[rad/s]"},
    "frequency": _NUMBER | {"description": "c_f [policy steps]"},
    "by_remote": {"type": "boolean", "description": "the wireless remote leads"},
    "stopping": {"type": "boolean", "description": "the program was told to end"},
}


class OperatorRecord(msgspec.Struct, frozen=True):
    """A message of that topic."""

    request: str
    vx: float
    wz: float
    frequency: float
    by_remote: bool
    stopping: bool


class McapWriter:
    """Writes ticks. Raises OSError whenever the disk does."""

    def __init__(self, stream: IO[bytes], about: LogMetadata, *, compact: bool = False) -> None:
        """``stream`` is open for writing and is not closed here; ``compact`` leaves out what a
        replay does not need, the daemon's inside and the index of messages."""
        try:
            from mcap.writer import IndexType, Writer
        except ModuleNotFoundError as error:
            raise Failure(NEEDS.format(error.name)) from error
        self._writer = Writer(stream, index_types=IndexType.CHUNK if compact else IndexType.ALL)
        self._writer.start()
        self._about = about
        self._states = about.machine_table().states
        self._row_type = row_type(about.columns)
        self._compact = compact
        self._orders: tuple | None = None
        plain = msgspec.to_builtins(about)
        entries = {name: msgspec.json.encode(value).decode() for name, value in plain.items()}
        self._writer.add_metadata(METADATA, entries)
        numbers = SCHEMA | dict.fromkeys(about.columns, _NUMBER)
        # PlotJuggler does not open files with a channel that has no schema
        self._channels = {
            STATE: self._channel(STATE, RAW, "a1.LowState", None),
            COMMAND: self._channel(COMMAND, RAW, "a1.LowCmd", None),
            ORDERS: self._channel(ORDERS, "json", "rmll.Orders", _ORDERS),
            INSIDE: self._channel(INSIDE, "json", "rmll.Inside", numbers),
        }

    def add(self, tick: Tick) -> None:
        """The command is written last: a tick that was cut short is seen to be so."""
        for datagram in tick.datagrams:
            self._message(STATE, tick, datagram)
        orders = tick.request, tick.command, tick.by_remote, tick.stopping
        if orders != self._orders:
            self._orders = orders
            message = OperatorRecord(
                tick.request or "", *tick.command, tick.by_remote, tick.stopping
            )
            self._message(ORDERS, tick, msgspec.json.encode(message))
        if tick.inside is not None and not self._compact:
            inside = row(tick.now, tick.inside, self._states, self._row_type)
            self._message(INSIDE, tick, msgspec.json.encode(inside))
        self._message(COMMAND, tick, tick.answer)

    def flush(self) -> None:
        """From here on the ticks so far can be read, whatever becomes of us."""
        self._writer.flush()

    def finish(self) -> None:
        """Add the index, with which a reader need not read all."""
        self._writer.finish()

    def _message(self, topic: str, tick: Tick, data: bytes) -> None:
        self._writer.add_message(
            self._channels[topic], tick.now, data, publish_time=tick.now, sequence=tick.number
        )

    def _channel(
        self, topic: str, encoding: str, name: str, properties: Mapping[str, Any] | None
    ) -> int:
        if properties is None:
            schema = self._writer.register_schema(name, "", b"")
        else:
            plain = {"title": name, "type": "object", "properties": properties}
            schema = self._writer.register_schema(name, "jsonschema", msgspec.json.encode(plain))
        return self._writer.register_channel(topic, encoding, schema)


@contextmanager
def log_file(path: Path, about: LogMetadata, *, compact: bool = False) -> Iterator[McapWriter]:
    """A new log, which has its proper end when the block ends."""
    with path.open("xb") as stream:
        log = McapWriter(stream, about, compact=compact)
        try:
            yield log
        finally:
            log.finish()
