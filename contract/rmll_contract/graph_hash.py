"""Fingerprint of the network in an ONNX file, without the onnx package.

An ONNX file is one protobuf message, ModelProto; its field 7 is the graph with all weights. The
exporter and the robot hash those bytes as they lie in the file, so any later edit shows.
"""

import hashlib

from rmll_gaits.errors import InputError

_GRAPH_FIELD = 7
# Protobuf wire types, https://protobuf.dev/programming-guides/encoding
_VARINT, _FIXED64, _LENGTH_PREFIXED, _FIXED32 = 0, 1, 2, 5


def graph_sha256(model: bytes) -> str:
    """Hex digest of the serialised graph in an ONNX model.

    Raises InputError if the bytes are no protobuf message with exactly one graph in it.
    """
    graphs = []
    position = 0
    while position < len(model):
        key, position = _varint(model, position)
        field, kind = key >> 3, key & 7
        if kind == _VARINT:
            _, end = _varint(model, position)
        elif kind == _FIXED64:
            end = position + 8
        elif kind == _FIXED32:
            end = position + 4
        elif kind == _LENGTH_PREFIXED:
            length, position = _varint(model, position)
            end = position + length
        else:
            raise InputError("not an ONNX file")
        if end > len(model):
            raise InputError("the ONNX file is truncated")
        if field == _GRAPH_FIELD:
            graphs.append(model[position:end])
        position = end
    if len(graphs) != 1:
        raise InputError(f"not an ONNX file: {len(graphs)} graphs in it, expected 1")
    return hashlib.sha256(graphs[0]).hexdigest()


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
