"""A bundle is loaded and proven, and whatever is wrong with one is told in a line."""

import msgspec
import numpy as np
import onnx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from onnx import helper

from rmll_common.errors import InputError
from rmll_contract.contract import KEY
from rmll_contract.observation import Field
from rmll_onboard.control import bundle as bundles
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import prove
from rmll_robots import A1


def refusal(path) -> str:
    with pytest.raises(InputError) as refused:
        prove(load_bundle(path))
    return str(refused.value)


def edited(path, old: bytes, new: bytes):
    data = path.read_bytes()
    assert data.count(old) >= 1
    assert len(old) == len(new)
    path.write_bytes(data.replace(old, new))
    return path


def test_a_whole_bundle_is_proven(bundle_path):
    bundle = load_bundle(bundle_path)
    assert prove(bundle) == 40
    assert bundle.contract.gait == bundle.table.gait == "trot"
    assert bundle.joints.tolist() == list(range(12))


def test_joints_are_matched_by_name(make_bundle):
    names = A1.joint_names[6:] + A1.joint_names[:6]
    bundle = load_bundle(make_bundle(joint_names=names))
    assert prove(bundle)
    assert [A1.joint_names[index] for index in bundle.joints] == list(names)


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.5, 0.9, 0.999])
def test_a_truncated_bundle_is_refused(bundle_path, tmp_path, share):
    data = bundle_path.read_bytes()
    path = tmp_path / "cut.onnx"
    path.write_bytes(data[: int(len(data) * share)])
    assert refusal(path).startswith("cut.onnx: ")


def test_files_that_are_no_bundles_are_refused(tmp_path, make_network):
    path = tmp_path / "x.onnx"
    assert "No such file" in refusal(path)
    assert "directory" in refusal(tmp_path)
    path.write_text("states: [q0, q1]\n")
    assert "not an ONNX file" in refusal(path)
    path.write_bytes(bytes(100))
    assert "not an ONNX file" in refusal(path)
    path.write_bytes(b"\x3a\x03abc")
    assert f"no '{KEY}' entry" in refusal(path)
    path.write_bytes(make_network(49).SerializeToString())
    assert f"no '{KEY}' entry" in refusal(path)


def test_a_network_that_onnxruntime_does_not_know_is_refused(make_bundle, make_network):
    trace = load_bundle(make_bundle()).contract.trace
    strange = make_network(49)
    strange.graph.node[0].op_type = "NoSuchOperator"
    assert "onnxruntime refuses it" in refusal(make_bundle(strange, trace=trace))


@pytest.mark.fuzz
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_bundle_is_refused_or_as_good_as_new(bundle_path, tmp_path, data):
    """Bytes changed, left out or put in anywhere: one line, or the same gait."""
    whole = bundle_path.read_bytes()
    start = data.draw(st.integers(0, len(whole)))
    dropped = data.draw(st.integers(0, 40))
    path = tmp_path / "damaged.onnx"
    path.write_bytes(whole[:start] + data.draw(st.binary(max_size=40)) + whole[start + dropped :])
    try:
        bundle = load_bundle(path)
        prove(bundle)
    except InputError as error:
        assert str(error).startswith("damaged.onnx: ")
    else:
        assert bundle.contract == load_bundle(bundle_path).contract


def test_a_file_that_is_too_large_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr(bundles, "MAX_BYTES", 1 << 20)
    path = tmp_path / "x.onnx"
    path.write_bytes(bytes((1 << 20) + 1))
    assert "larger than 1 MB" in refusal(path)


def test_an_edited_table_is_refused(make_bundle):
    path = edited(make_bundle(), b'"states":["q0"', b'"states":["Q0"')
    assert "edited" in refusal(path)


def test_edited_weights_are_refused(make_bundle):
    path = make_bundle()
    model = onnx.load(path)
    weights = bytearray(model.graph.initializer[0].raw_data)
    weights[3] ^= 1
    model.graph.initializer[0].raw_data = bytes(weights)
    path.write_bytes(model.SerializeToString())
    assert "network was edited" in refusal(path)


def test_another_format_version_is_refused(make_bundle):
    assert "format version 2, this rmll reads 1" in refusal(make_bundle(format=2))


def test_a_contract_that_is_none_is_refused(make_bundle):
    path = make_bundle()
    for text in ("", "no JSON", '{"format":1}', '{"format":"a"}'):
        model = onnx.load(path)
        del model.metadata_props[:]
        helper.set_model_props(model, {KEY: text})
        path.write_bytes(model.SerializeToString())
        assert "contract cannot be read" in refusal(path)


def test_strange_joints_are_named(make_bundle):
    path = make_bundle()
    names = ("XX_hip_joint", *A1.joint_names[1:])
    trace = load_bundle(path).contract.trace
    message = refusal(make_bundle(joint_names=names, trace=trace))
    assert "unknown ['XX_hip_joint'], missing ['FR_hip_joint']" in message


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robot": "a2"}, "unknown robot 'a2'; known: a1"),
        ({"table": {}}, "gait table"),
        ({"observation": (Field("rm_state", 3, 1.0), Field("smell", 4, 1.0))}, "smell"),
        ({"observation": (Field("rm_state", 4, 1.0),)}, "rm_state"),
        ({"default_pose": (0.0,) * 11}, "default_pose is not 12"),
        ({"kp": 0.0}, "kp is 0.0"),
        ({"kd": -1.0}, "kd is -1.0"),
        ({"torque_limit": 40.0}, "torque_limit is 40.0, expected more than 0 and at most 33.5"),
        ({"policy_hz": 60}, "policy_hz 60 and control_hz 200"),
        ({"policy_hz": 0}, "policy_hz 0"),
        ({"estimates": (Field("foot_height", 4, 1.0),)}, "its network has"),
        ({"estimates": (Field("velocity", 3, 2.0),)}, "one foot_height of 4"),
    ],
)
def test_a_contract_that_does_not_fit_is_refused(make_bundle, make_network, changes, words):
    trace = load_bundle(make_bundle()).contract.trace
    message = refusal(make_bundle(make_network(49), trace=trace, **changes))
    assert words in message
    assert "\n" not in message


def test_a_network_of_another_size_is_refused(make_bundle, make_network):
    trace = load_bundle(make_bundle()).contract.trace
    message = refusal(make_bundle(make_network(48), trace=trace))
    assert "tensor(float) [1, 48]" in message
    assert "tensor(float) [1, 49]" in message


@pytest.mark.parametrize("name", ["touching", "command", "phi", "target"])
def test_a_trace_that_is_cut_or_bent_is_refused(make_bundle, name):
    trace = load_bundle(make_bundle()).contract.trace
    rows = getattr(trace, name)
    bent = [row[:-1] for row in rows] if isinstance(rows[0], list) else rows[:-1]
    for value in (rows[:-1], bent):
        message = refusal(make_bundle(trace=msgspec.structs.replace(trace, **{name: value})))
        assert f"golden trace: {name}" in message


@pytest.mark.parametrize("name", ["label", "state", "phi", "observation", "estimate", "target"])
def test_a_trace_that_does_not_reproduce_names_step_and_field(make_bundle, name):
    trace = load_bundle(make_bundle()).contract.trace
    rows = np.array(getattr(trace, name))
    rows[7] = rows[7] + (1 if rows.dtype == int else 1e-3)
    changed = msgspec.structs.replace(trace, **{name: rows.tolist()})
    assert f"step 7, {name}[0]:" in refusal(make_bundle(trace=changed))
