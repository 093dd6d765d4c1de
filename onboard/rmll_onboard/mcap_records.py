"""The records of an MCAP file, as mcap.dev/spec has them, walked with bounded sizes.

The ``mcap`` package writes our files, but believes any length that a file claims when it reads.
Everything here raises ValueError (struct.error for a body that is too short).
"""

import struct
import zlib
from collections.abc import Iterator
from typing import IO, NamedTuple

LARGEST = 32 * 1024 * 1024
"""[bytes] of one record, packed or unpacked; a second of a log is about 0.5 MB"""
MAGIC = b"\x89MCAP0\r\n"
FOOTER, CHANNEL, MESSAGE, CHUNK, METADATA = 0x02, 0x04, 0x05, 0x06, 0x0C
"""Opcodes"""

# Little-endian; a string is its length (u32) and its bytes
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHANNEL = struct.Struct("<HH")
_CHUNK = struct.Struct("<QQQI")
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")


class Message(NamedTuple):
    channel: int
    sequence: int
    time: int
    """[ns]"""
    data: bytes


def records(stream: IO[bytes]) -> Iterator[tuple[int, bytes]]:
    """Opcode and body of each whole record from here on; a crash may have cut the last one."""
    while len(head := stream.read(_RECORD.size)) == _RECORD.size:
        opcode, length = _RECORD.unpack(head)
        if opcode == 0:  # no record has it: a file's empty end after a power cut
            return
        if length > LARGEST:
            raise ValueError(f"a record of {length} bytes, expected at most {LARGEST}")
        body = stream.read(length)
        if len(body) < length:
            return
        yield opcode, body


def metadata(body: bytes) -> tuple[str, dict[str, str]]:
    """Name and entries."""
    name, position = _string(body, 0)
    (length,) = _U32.unpack_from(body, position)
    position += _U32.size
    end = position + length
    entries = {}
    while position < end:
        key, position = _string(body, position)
        entries[key], position = _string(body, position)
    return name, entries


def channel(body: bytes) -> tuple[int, str]:
    """Number and topic."""
    number, _schema = _CHANNEL.unpack_from(body)
    return number, _string(body, _CHANNEL.size)[0]


def message(body: bytes) -> Message:
    number, sequence, time, _published = _MESSAGE.unpack_from(body)
    return Message(number, sequence, time, body[_MESSAGE.size :])


def unpack(body: bytes) -> bytes:
    """The records in a chunk, packed with zstd."""
    import zstandard

    _, _, size, checksum = _CHUNK.unpack_from(body)
    compression, position = _string(body, _CHUNK.size)
    if compression != "zstd":
        raise ValueError(f"packed by {compression!r}, expected 'zstd'")
    packed = body[position + _U64.size :]
    try:
        # what the data says of its own size is what would be allocated
        if max(size, zstandard.frame_content_size(packed)) > LARGEST:
            raise ValueError(f"more than {LARGEST} bytes when unpacked")
        unpacked = zstandard.decompress(packed, max_output_size=LARGEST)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error
    if zlib.crc32(unpacked) != checksum:
        raise ValueError("its checksum does not match")
    return unpacked


def _string(body: bytes, position: int) -> tuple[str, int]:
    """The string at ``position``, and the position after it."""
    (length,) = _U32.unpack_from(body, position)
    start = position + _U32.size
    if start + length > len(body):
        raise ValueError("a string longer than its record")
    return body[start : start + length].decode(), start + length
