"""The records of an MCAP file, as mcap.dev/spec has them: one that is damaged costs itself alone.

What a record holds is read by the ``mcap`` package. It believes any length that a file claims, so
records are cut out and chunks unpacked here, within bounds. Where a chunk is damaged, or a length
leads nowhere, the next chunk is looked for.
"""

import io
import re
import struct
import zlib
from collections.abc import Container, Iterator
from typing import IO, TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # the base install has no logs
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Chunk, McapRecord

LARGEST = 32 * 1024 * 1024
"""[bytes] of one record, packed or unpacked; a second of a log is about 0.5 MB"""
MAGIC = b"\x89MCAP0\r\n"
FOOTER, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS, METADATA = 2, 4, 5, 6, 8, 11, 12
"""Opcodes"""
_KNOWN, _PRIVATE = range(1, 16), range(128, 256)
"""Those of this version of the format, and those that anybody may use"""

_HEAD = struct.Struct("<BQ")
_FOOTER = struct.Struct("<QQI")
_SIZE = rb"[\s\S]{3}[\x00-\x02]\x00{4}"
_CHUNK_HEAD = re.compile(
    rb"\x06" + _SIZE + rb"[\s\S]{16}" + _SIZE + rb"[\s\S]{4}"
    rb"(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)"
)  # fmt: skip
"""Opcode, length, two times, unpacked length, checksum, compression"""
_BLOCK, _OVERLAP = 1 << 20, 64
"""[bytes] that are searched in one go, and that two of them share"""


class Lost(NamedTuple):
    """Something that was there and cannot be read."""

    why: str


class Summary(NamedTuple):
    """What a finished file says at its end."""

    channels: "list[Channel]"
    chunks: set[int]
    """Where they begin, as far as it says so"""
    messages: int | None
    """How many there are in it, None if it does not say"""


def records(stream: IO[bytes], position: int = len(MAGIC)) -> Iterator[tuple[int, bytes]]:
    """Opcode and body of each record from ``position`` on, up to what is none."""
    while (head := _head(stream, position)) is not None:
        opcode, length = head
        yield opcode, stream.read(length)
        position += _HEAD.size + length


def chunks(stream: IO[bytes], known: Container[int]) -> "Iterator[list[McapRecord] | Lost]":
    """Channels and messages, chunk by chunk, and where some are lost.

    ``known``: where chunks begin by the summary; there may be more. A last chunk that was cut short
    is no loss: it was not written yet.
    """
    position: int | None = len(MAGIC)
    done = position
    while position is not None:
        opcode, length = _head(stream, position) or (0, 0)
        end = position + _HEAD.size + length
        content = None
        if opcode == FOOTER:
            return
        if opcode == CHUNK:
            content = _unpacked(stream.read(length))
        elif opcode in (CHANNEL, MESSAGE):  # of a file without chunks
            content = _content(_HEAD.pack(opcode, length) + stream.read(length))
        elif position in known:
            content = Lost("there is no chunk where one should be")
        elif opcode:
            position = end
            continue
        if isinstance(content, list):
            yield content
            position = done = end
            continue
        done = max(done, position + 1) if opcode else done
        position = _next_chunk(stream, done)
        if content is not None or position is not None:
            yield content or Lost("what is there is no record")


def summary(stream: IO[bytes]) -> Summary | None:
    """None for a file without its proper end."""
    from mcap.records import Channel, ChunkIndex, Statistics

    start = _summary_start(stream)
    if start is None:
        return None
    channels, chunks, messages = [], set(), None
    try:
        for opcode, body in records(stream, start) if start else ():
            if opcode == CHANNEL:
                channels.append(Channel.read(_bounded(body)))
            elif opcode == CHUNK_INDEX:
                chunks.add(ChunkIndex.read(_bounded(body)).chunk_start_offset)
            elif opcode == STATISTICS:
                messages = Statistics.read(_bounded(body)).message_count
    except _errors():
        pass
    return Summary(channels, chunks, messages)


def metadata(body: bytes) -> tuple[str, dict[str, str]]:
    """Name and entries; raises ValueError."""
    from mcap.records import Metadata

    try:
        record = Metadata.read(_bounded(body))
    except _errors() as error:
        raise ValueError(_said(error)) from error
    return record.name, record.metadata


def _head(stream: IO[bytes], position: int) -> tuple[int, int] | None:
    """Opcode and length of a whole record; None if there is none. The body comes next."""
    size = stream.seek(0, io.SEEK_END)
    stream.seek(position)
    head = stream.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    opcode, length = _HEAD.unpack(head)
    end = position + _HEAD.size + length
    # no record has opcode 0: a file's end that a power cut left empty
    if (opcode not in _KNOWN and opcode not in _PRIVATE) or length > LARGEST or end > size:
        return None
    is_last = length == _FOOTER.size and end + len(MAGIC) == size
    return (opcode, length) if opcode != FOOTER or is_last else None


def _next_chunk(stream: IO[bytes], position: int) -> int | None:
    """Where the first thing from ``position`` on begins that looks like a whole chunk."""
    while True:
        stream.seek(position)
        block = stream.read(_BLOCK + _OVERLAP)
        for found in _CHUNK_HEAD.finditer(block):
            if _head(stream, position + found.start()):
                return position + found.start()
        if len(block) <= _BLOCK:
            return None
        position += _BLOCK


def _summary_start(stream: IO[bytes]) -> int | None:
    """Where the summary begins, 0 for a file that has none; None for one without a footer."""
    size = stream.seek(0, io.SEEK_END)
    footer = size - len(MAGIC) - _FOOTER.size - _HEAD.size
    if footer < len(MAGIC) or _head(stream, footer) != (FOOTER, _FOOTER.size):
        return None
    return _FOOTER.unpack(stream.read(_FOOTER.size))[0]


def _unpacked(body: bytes) -> "list[McapRecord] | Lost":
    """The records in a chunk."""
    from mcap.records import Chunk

    try:
        chunk = Chunk.read(stream := _bounded(body))
        if stream.count != len(body):  # where the next record begins is not sure
            return Lost("its length does not match")
        data = _decompressed(chunk)
    except _errors() as error:
        return Lost(_said(error))
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        return Lost("its checksum does not match")
    return _content(data)


def _content(data: bytes) -> "list[McapRecord] | Lost":
    """Channels and messages that follow each other."""
    from mcap.records import Chunk
    from mcap.stream_reader import breakup_chunk

    try:
        return breakup_chunk(Chunk("", data, 0, 0, 0, len(data)))
    except _errors() as error:
        return Lost(_said(error))


def _decompressed(chunk: "Chunk") -> bytes:
    """Never more than it should become, whatever the packed data claim."""
    import zstandard
    from lz4.frame import LZ4FrameDecompressor

    wanted = chunk.uncompressed_size
    if wanted > LARGEST:
        raise ValueError(f"more than {LARGEST} bytes when unpacked")
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "lz4":
        data = LZ4FrameDecompressor().decompress(chunk.data, max_length=wanted + 1)
    elif chunk.compression == "zstd":
        unpacker = zstandard.ZstdDecompressor(max_window_size=LARGEST)
        data = unpacker.stream_reader(chunk.data).read(wanted + 1)
    else:
        raise ValueError(f"packed by {chunk.compression!r}, expected lz4, zstd or nothing")
    if len(data) != wanted:
        raise ValueError(f"{len(data)} bytes when unpacked, expected {wanted}")
    return data


def _bounded(body: bytes) -> "ReadDataStream":
    """Of a record's own bytes, so that no length in it leads beyond them."""
    from mcap.data_stream import ReadDataStream

    return ReadDataStream(io.BytesIO(body))


def _errors() -> tuple[type[Exception], ...]:
    """What broken bytes can make of the libraries; lz4 has no error of its own."""
    import zstandard
    from mcap.exceptions import McapError

    return McapError, zstandard.ZstdError, RuntimeError, ValueError, struct.error


def _said(error: Exception) -> str:
    return str(error) or "it ends too soon"
