"""Fingerprint and metadata of an ONNX file, against the onnx package."""

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper

from rmll_common.errors import InputError
from rmll_contract.onnx_file import graph_sha256, metadata


def model():
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3]) for name in "xy"]
    graph = helper.make_graph([helper.make_node("Tanh", ["x"], ["y"])], "g", values[:1], values[1:])
    return helper.make_model(graph, producer_name="test")


def test_hash_is_of_the_serialised_graph_whatever_lies_around_it():
    expected = hashlib.sha256(model().graph.SerializeToString()).hexdigest()
    dressed = model()
    dressed.doc_string = "x" * 300
    helper.set_model_props(dressed, {"rmll": "{}"})
    assert graph_sha256(model().SerializeToString()) == expected
    assert graph_sha256(dressed.SerializeToString()) == expected


@given(st.dictionaries(st.text(max_size=20), st.text(), max_size=4))
def test_metadata_comes_back(texts):
    dressed = model()
    helper.set_model_props(dressed, texts)
    assert metadata(dressed.SerializeToString()) == texts


def test_metadata_that_is_there_twice_or_no_text_is_refused():
    dressed = model()
    helper.set_model_props(dressed, {"rmll": "{}"})
    again = dressed.metadata_props.add()
    again.key, again.value = "rmll", "[]"
    with pytest.raises(InputError, match="'rmll' twice"):
        metadata(dressed.SerializeToString())
    with pytest.raises(InputError, match="no text"):
        metadata(b"\x72\x03\x0a\x01\xff")


@pytest.mark.parametrize("extra", [b"\x19" + bytes(8), b"\x1d" + bytes(4), b"\x18\xff\x01"])
def test_fields_of_every_kind_are_passed_over(extra):
    data = model().SerializeToString()
    assert graph_sha256(extra + data) == graph_sha256(data)


def test_every_truncation_is_noticed_or_leaves_the_graph_whole():
    data = model().SerializeToString()
    whole = graph_sha256(data)
    for length in range(len(data)):
        try:
            assert graph_sha256(data[:length]) == whole
        except InputError:
            continue


def test_two_graphs_are_refused():
    data = model().SerializeToString()
    with pytest.raises(InputError, match="2 graphs"):
        graph_sha256(data + data)


@pytest.mark.fuzz
@given(st.binary())
def test_any_bytes_give_a_hash_or_one_line(data):
    try:
        assert len(graph_sha256(data)) == 64
        assert isinstance(metadata(data), dict)
    except InputError as error:
        assert "\n" not in str(error)
