"""Logs written and read back: whole, cut short, damaged, and files that never were one."""

import io
import json
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import lz4.frame
import msgspec
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from msgspec.structs import asdict

from rmll_common.errors import InputError
from rmll_onboard.recording import mcap_reader
from rmll_onboard.recording.flight_log import FlightLog
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.mcap_writer import (
    COMMAND,
    INSIDE,
    METADATA,
    ORDERS,
    McapWriter,
    log_file,
)
from rmll_onboard.recording.telemetry import ControllerSample, Tick
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.modes import Request

# each example writes a file, and a busy disk takes its time
ON_FILES = settings(
    deadline=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture(scope="module")
def about(bundle_path):
    from rmll_onboard.control.bundle import load_bundle

    return describe(load_bundle(bundle_path), RuntimeSettings(), real_time=True)


def tick(number: int, about, **changes) -> Tick:
    inside = ControllerSample(
        mode="walking", fault="", label=6, state=1, phi=3, advanced=True, off_spec=False,
        command=(0.5, 0.0, 8.0), values=bytes(4 * len(about.columns)),
    )  # fmt: skip
    whole = Tick(
        number, number * 5_000_000, [bytes(771)], bytes([number % 256]) * 610, Request.WALK,
        (0.5, 0.1, 8.0), False, False, None if number % 4 else inside,
    )  # fmt: skip
    return msgspec.structs.replace(whole, **changes)


@pytest.fixture(scope="module")
def log(about, tmp_path_factory) -> Path:
    """100 ticks in five chunks."""
    path = tmp_path_factory.mktemp("log") / "walk.mcap"
    with log_file(path, about) as file:
        for number in range(100):
            file.add(tick(number, about))
            if number % 20 == 19:
                file.flush()
    return path


def read(path: Path) -> tuple[list[Tick], list[dict]]:
    log = FlightLog(path)
    return list(log.ticks()), list(log.rows())


finite = st.floats(allow_nan=False, allow_infinity=False)
some_ticks = st.lists(
    st.tuples(
        st.lists(st.binary(max_size=2048), max_size=4),
        st.binary(min_size=1, max_size=610),
        st.none() | st.sampled_from(Request),
        st.tuples(finite, finite, finite),
        st.booleans(),
        st.booleans(),
    ),
    max_size=5,
)


@ON_FILES
@given(some_ticks)
def test_what_was_kept_comes_back(about, tmp_path, entries):
    path = tmp_path / "log.mcap"
    path.unlink(missing_ok=True)
    ticks = [Tick(number, number * 7, *entry, None) for number, entry in enumerate(entries)]
    with log_file(path, about) as file:
        for one in ticks:
            file.add(one)
    log = FlightLog(path)
    assert list(log.ticks()) == ticks
    assert log.complete
    assert log.about == about


def test_the_inside_comes_back_as_rows(log, about):
    _, rows = read(log)
    assert len(rows) == 25
    assert asdict(rows[1]) == {
        "t_ns": 20_000_000, "mode": "walking", "fault": "", "label": 6, "down_FR": 0, "down_FL": 1,
        "down_RR": 1, "down_RL": 0, "state": "q1", "phi": 3, "advanced": 1, "off_spec": 0,
        "vx": 0.5, "wz": 0.0, "frequency": 8.0, **dict.fromkeys(about.columns, 0.0),
    }  # fmt: skip


def test_another_reader_finds_topics_schemas_and_an_index(log, about):
    """What Foxglove and PlotJuggler need: a summary, and a schema for every channel."""
    with log.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        counts = {
            channel.topic: summary.statistics.channel_message_counts[number]
            for number, channel in summary.channels.items()
        }
        assert counts == {"/state_datagram": 100, "/command_datagram": 100, "/orders": 1,
                          "/inside": 25}  # fmt: skip
        for schema, channel, message in reader.iter_messages([ORDERS, INSIDE]):
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            described = json.loads(schema.data)
            assert described["type"] == "object"
            assert set(described["properties"]) == set(json.loads(message.data))
        assert all(channel.schema_id for channel in summary.channels.values())
        (metadata,) = reader.iter_metadata()
    assert json.loads(metadata.metadata["digest"]) == about.digest


def unfinished(about, flushed: int, more: int = 0) -> bytes:
    """The file of a recorder that was killed, after ``flushed`` ticks had gone to the disk."""
    stream = io.BytesIO()
    file = McapWriter(stream, about)
    for number in range(flushed):
        file.add(tick(number, about))
    file.flush()
    for number in range(flushed, flushed + more):
        file.add(tick(number, about))
    return stream.getvalue()


@pytest.mark.parametrize("end", [b"", bytes(5000), b"\x06\x00\x10", b"\x06\x00\x10" + bytes(100)])
def test_a_recorder_that_was_killed_leaves_all_that_was_flushed(about, tmp_path, end):
    """Also with an end that a power cut left empty, or in the midst of a record."""
    path = tmp_path / "killed.mcap"
    path.write_bytes(unfinished(about, 40, more=10) + end)
    log = FlightLog(path)
    assert [found.number for found in log.ticks()] == list(range(40))
    assert not log.complete


def packed(log: Path, path: Path, **how) -> Path:
    """The log written again by the stock writer."""
    with log.open("rb") as read, path.open("wb") as written:
        reader = make_reader(read)
        writer = Writer(written, chunk_size=20_000, **how)
        writer.start()
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        numbers: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in numbers:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                encoding = channel.message_encoding
                numbers[channel.id] = writer.register_channel(channel.topic, encoding, number)
            writer.add_message(numbers[channel.id], message.log_time, message.data,
                               message.publish_time, message.sequence)  # fmt: skip
        writer.finish()
    return path


@pytest.mark.parametrize(
    "how",
    [
        *({"compression": compression} for compression in CompressionType),
        {"compression": CompressionType.LZ4, "enable_crcs": False},
        {"use_chunking": False},
        {"use_summary_offsets": False, "use_statistics": False, "repeat_channels": False},
    ],
    ids=str,
)
def test_whatever_a_log_is_packed_with_it_is_the_same(log, tmp_path, how):
    again = FlightLog(packed(log, tmp_path / "again.mcap", **how))
    assert list(again.ticks()) == read(log)[0]
    assert (again.complete, again.gaps) == (True, [])
    assert list(again.rows()) == read(log)[1]


def places(data: bytes) -> list[tuple[int, int]]:
    """Where each chunk begins and ends."""
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary
    spans = [(index.chunk_start_offset, index.chunk_length) for index in summary.chunk_indexes]
    return sorted((start, start + length) for start, length in spans)


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("finished", [True, False])
def test_a_damaged_chunk_costs_that_chunk_alone(log, tmp_path, compression, finished):
    """Whichever of its bytes it is: opcode, length, sizes, checksum, name or data."""
    data = packed(log, tmp_path / "whole.mcap", compression=compression).read_bytes()
    chunks = places(data)
    whole, rows = read(log)
    kept = data if finished else data[: chunks[-1][1]]
    path = tmp_path / "damaged.mcap"
    for number, (start, end) in enumerate(chunks):
        for place in (0, 1, 2, 3, 8, 26, 33, 40, 42, 46, 70, end - start - 1):
            damaged = bytearray(kept)
            damaged[start + place] ^= 0x55
            path.write_bytes(damaged)
            damaged_log = FlightLog(path)
            ticks = list(damaged_log.ticks())
            at = (compression, number, place)
            if not finished and number < 2 and not ticks:
                continue  # the topics' names were in it alone
            left = {tick.number for tick in ticks}
            missing = {tick.number for tick in whole} - left
            if not missing:  # it was of no use
                assert ticks == whole
                continue
            assert 0 < len(missing) < 2 * 100 // len(chunks) + 6, at
            if not finished and number == len(chunks) - 1 and not damaged_log.gaps:
                continue  # nothing shows that it was not cut short
            told = damaged_log.gaps[0]
            assert {*range(told.first, 100 if told.last is None else told.last + 1)} == missing, at
            assert len(damaged_log.gaps) == 1, at
            assert damaged_log.complete == finished
            assert bool(damaged_log.lost) == finished
            assert all(row in rows for row in damaged_log.rows())


def test_a_log_that_was_cut_anywhere_keeps_its_whole_chunks_or_is_none(log, tmp_path):
    data, whole = log.read_bytes(), read(log)[0]
    path = tmp_path / "cut.mcap"
    kept = set()
    for length in range(0, len(data), 411):
        path.write_bytes(data[:length])
        try:
            ticks, _ = read(path)
        except InputError as error:
            assert length < 10_000, error  # before its metadata ends
            continue
        assert ticks == whole[: len(ticks)]
        kept.add(len(ticks))
    assert kept == {0, 20, 40, 60, 80, 100}


def chunk(records: bytes, *, size: int | None = None, compression: str = "zstd") -> bytes:
    packed = lz4.frame.compress(records) if compression == "lz4" else zstandard.compress(records)
    name = compression.encode()
    body = struct.pack("<QQQI", 0, 0, len(records) if size is None else size, zlib.crc32(records))
    body += struct.pack("<I", len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", mcap_reader.CHUNK, len(body)) + body


def with_messages(about, messages: dict[str, bytes]) -> bytes:
    """A log with well-formed records, and anything in its messages."""
    stream = io.BytesIO()
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start()
    plain = msgspec.to_builtins(about)
    writer.add_metadata(METADATA, {name: json.dumps(value) for name, value in plain.items()})
    for topic, data in messages.items():
        channel = writer.register_channel(topic, "json", 0)
        writer.add_message(channel, log_time=5, data=data, publish_time=5)
    writer.finish()
    return stream.getvalue()


def test_bad_logs_are_one_line(about, log, tmp_path):
    good = log.read_bytes()
    begin = unfinished(about, 0)
    orders = json.dumps(
        {"request": "fly", "vx": 0, "wz": 0, "frequency": 8, "by_remote": False, "stopping": False}
    )
    cases = {
        b"": "not an MCAP file",
        b"PK\x03\x04 zipped": "not an MCAP file",
        mcap_reader.MAGIC: "no 'rmll' entry",
        mcap_reader.MAGIC + b"\x06" + b"\xff" * 8: "no 'rmll' entry",
        good.replace(b"format\x01\x00\x00\x001", b"format\x01\x00\x00\x007"): "format 7, this",
        good.replace(b'"trot"', b'[\\"\\"]'[:6]): "metadata cannot be read",
        begin + chunk(bytes(1 << 20), size=1 << 40): "no chunk of it can be read: more than 3355",
        begin + chunk(bytes(40 << 20)): "no chunk of it can be read: more than 33554432 bytes",
        begin + chunk(bytes(40 << 20), size=100): "101 bytes when unpacked, expected 100",
        begin + chunk(bytes(40 << 20), size=100, compression="lz4"): "101 bytes when unpacked",
        begin + chunk(bytes(9), compression=""): "when unpacked, expected 9",
        begin + chunk(b"", compression="brotli"): "packed by 'brotli', expected lz4, zstd or noth",
        with_messages(about, {COMMAND: bytes(610)}): "tick 0 is not where it should be",
        with_messages(about, {ORDERS: b"[1]"}): "/orders of tick 0 cannot be read: Expected",
        with_messages(about, {ORDERS: orders.encode()}): "'fly' is not a valid Request",
        with_messages(about, {INSIDE: b"[" * 100_000}): "/inside of tick 0 cannot be read",
    }
    path = tmp_path / "bad.mcap"
    for data, complaint in cases.items():
        path.write_bytes(data)
        with pytest.raises(InputError) as caught:
            read(path)
        assert complaint in str(caught.value)
        assert str(caught.value).startswith("bad.mcap: ")
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"none\.mcap: No such file"):
        FlightLog(tmp_path / "none.mcap")
    with pytest.raises(InputError, match=r"Is a directory"):
        FlightLog(tmp_path)


def test_rows_that_lack_what_is_wanted_are_refused(log):
    class Wanted(msgspec.Struct):
        label: int
        beauty: float

    with pytest.raises(InputError, match=r"/inside of tick 0 .* missing required field `beauty`"):
        list(FlightLog(log).rows_of(Wanted))


def read_or_refuse(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    try:
        read(path)
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.fuzz
@ON_FILES
@given(data=st.data())
def test_damaged_logs_are_read_or_refused(log, tmp_path, data):
    damaged = bytearray(log.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(damaged) - 1))
        length = data.draw(st.integers(0, 12))
        damaged[position : position + length] = data.draw(st.binary(max_size=12))
    read_or_refuse(tmp_path / "damaged.mcap", bytes(damaged))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


@pytest.mark.fuzz
@ON_FILES
@given(entries=st.dictionaries(st.sampled_from([COMMAND, ORDERS, INSIDE, "/x"]), json_values))
def test_messages_of_any_kind_are_read_or_refused(about, tmp_path, entries):
    messages = {topic: json.dumps(value).encode() for topic, value in entries.items()}
    read_or_refuse(tmp_path / "strange.mcap", with_messages(about, messages))


@pytest.mark.fuzz
@ON_FILES
@given(
    records=st.lists(
        st.tuples(st.integers(0, 16), st.binary(max_size=60)) | st.just((6, None)), max_size=6
    ),
    inner=st.lists(st.tuples(st.integers(0, 16), st.binary(max_size=40)), max_size=6),
)
def test_records_of_any_kind_are_read_or_refused(about, tmp_path, records, inner):
    packed = chunk(b"".join(struct.pack("<BQ", op, len(body)) + body for op, body in inner))
    data = b"".join(
        packed if body is None else struct.pack("<BQ", op, len(body)) + body for op, body in records
    )
    read_or_refuse(tmp_path / "records.mcap", unfinished(about, 2) + data)


def test_settings_and_table_are_checked_where_they_are_used(about, tmp_path):
    path = tmp_path / "log.mcap"
    odd = msgspec.structs.replace(about, settings={"feet": {"wings": 2}}, table={"states": []})
    path.write_bytes(with_messages(odd, {}))
    log = FlightLog(path)
    with pytest.raises(InputError, match="settings of another version"):
        log.about.daemon_settings()
    with pytest.raises(InputError, match="gait table"):
        log.about.machine_table()


def test_a_section_of_settings_that_is_none_is_refused(about):
    odd = msgspec.structs.replace(about, settings=about.settings | {"can": None})
    with pytest.raises(InputError, match="settings of another version"):
        odd.daemon_settings()


def test_columns_with_impossible_names_are_refused(about, tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(
        with_messages(msgspec.structs.replace(about, columns=["mode"]), {INSIDE: b"{}"})
    )
    with pytest.raises(InputError, match=r"log.mcap: the names of its columns .* 'mode'"):
        list(FlightLog(path).rows())


@pytest.mark.fuzz
@ON_FILES
@given(data=st.data())
def test_metadata_of_any_kind_is_read_or_refused(about, tmp_path, data):
    odd = msgspec.to_builtins(about)
    parts = {"about": odd, "table": odd["table"], "commands": odd["table"]["commands"],
             "settings": odd["settings"]}  # fmt: skip
    for _ in range(data.draw(st.integers(1, 3))):
        part = parts[data.draw(st.sampled_from(sorted(parts)))]
        part[data.draw(st.sampled_from(sorted(part)))] = data.draw(json_values)
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start()
    writer.add_metadata(METADATA, {name: json.dumps(value) for name, value in odd.items()})
    writer.finish()
    path = tmp_path / "odd.mcap"
    path.write_bytes(stream.getvalue())
    for use in (FlightLog.ticks, lambda log: log.about.daemon_settings(),
                lambda log: log.about.machine_table()):  # fmt: skip
        with suppress(InputError):
            use(FlightLog(path))
