"""What an ONNX file holds, without the onnx package and before onnxruntime opens it.

An ONNX file is one protobuf message, ModelProto. Its graph with all weights is hashed as it lies in
the file, by exporter and robot alike, so any later edit shows before the network is built from it.
"""

import hashlib
from collections.abc import Iterator

from rmll_common.errors import InputError

# Of ModelProto and StringStringEntryProto, onnx.proto
_GRAPH, _METADATA = 7, 14
_KEY, _VALUE = 1, 2
# Protobuf wire types, https://protobuf.dev/programming-guides/encoding
_VARINT, _FIXED64, _LENGTH_PREFIXED, _FIXED32 = 0, 1, 2, 5


def graph_sha256(model: bytes) -> str:
    """Hex digest of the serialised graph in an ONNX model.

    Raises InputError if the bytes are no protobuf message with exactly one graph in it.
    """
    graphs = [content for field, content in _fields(model) if field == _GRAPH]
    if len(graphs) != 1:
        raise InputError(f"not an ONNX file: {len(graphs)} graphs in it, expected 1")
    return hashlib.sha256(graphs[0]).hexdigest()


def metadata(model: bytes) -> dict[str, str]:
    """The texts that travel with the graph; raises InputError as :func:`graph_sha256` does, and
    for a key that is there twice."""
    found: dict[str, str] = {}
    for field, content in _fields(model):
        if field != _METADATA:
            continue
        entry = dict(_fields(content))
        try:
            key, value = (entry.get(part, b"").decode() for part in (_KEY, _VALUE))
        except UnicodeDecodeError as error:
            raise InputError("not an ONNX file: metadata that is no text") from error
        if key in found:
            raise InputError(f"its metadata has {key!r} twice")
        found[key] = value
    return found


def _fields(message: bytes) -> Iterator[tuple[int, bytes]]:
    """Number and content of each length-prefixed field of a protobuf message."""
    position = 0
    while position < len(message):
        key, position = _varint(message, position)
        kind = key & 7
        if kind == _VARINT:
            _, end = _varint(message, position)
        elif kind == _FIXED64:
            end = position + 8
        elif kind == _FIXED32:
            end = position + 4
        elif kind == _LENGTH_PREFIXED:
            length, position = _varint(message, position)
            end = position + length
        else:
            raise InputError("not an ONNX file")
        if end > len(message):
            raise InputError("the ONNX file is truncated")
        if kind == _LENGTH_PREFIXED:
            yield key >> 3, message[position:end]
        position = end


def _varint(data: bytes, position: int) -> tuple[int, int]:
    """Value of the varint at ``position``, and the position after it."""
    value = 0
    for shift in range(0, 70, 7):
        if position >= len(data):
            raise InputError("the ONNX file is truncated")
        byte = data[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise InputError("not an ONNX file")
