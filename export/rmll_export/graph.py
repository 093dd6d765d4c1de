"""The network as one ONNX graph: estimator, concatenation and policy inside, batch fixed to 1.

    observation (1, n) -> estimator -> estimate (1, 7)
    (observation, estimate * scale) -> policy -> action (1, 12)

A folded policy mirrors the observation in front of both and their answers behind them, in the
states that are turned. Built node by node: for a few layers that is simpler than tracing, and it
needs no torch.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from rmll_contract.contract import Contract
from rmll_export.checkpoint_reader import Checkpoint, Layers, MirrorFold

OPSET = 17
IR_VERSION = 9
"""Old enough for any onnxruntime since 1.16"""


def build(checkpoint: Checkpoint) -> onnx.ModelProto:
    """The model without metadata."""
    nodes: list[onnx.NodeProto] = []
    weights: list[onnx.TensorProto] = []
    fold = checkpoint.fold
    seen, estimated, acted = "observation", "estimate", "action"
    if fold is not None:
        _add_mirror_mask(fold, nodes, weights)
        seen, estimated, acted = "seen", "seen_estimate", "seen_action"
        _mirrored(fold, "observation", "observation", seen, nodes, weights)
    _mlp("estimator", checkpoint.estimator, seen, estimated, nodes, weights)
    weights.append(numpy_helper.from_array(_scales(checkpoint.contract), "estimate_scale"))
    nodes.append(helper.make_node("Mul", [estimated, "estimate_scale"], ["scaled_estimate"]))
    nodes.append(helper.make_node("Concat", [seen, "scaled_estimate"], ["policy_input"], axis=1))
    _mlp("policy", checkpoint.policy, "policy_input", acted, nodes, weights)
    if fold is not None:
        _mirrored(fold, "estimate", estimated, "estimate", nodes, weights)
        _mirrored(fold, "action", acted, "action", nodes, weights)
    graph = helper.make_graph(
        nodes,
        checkpoint.contract.gait,
        [_value("observation", checkpoint.estimator[0][0].shape[1])],
        [
            _value("action", checkpoint.policy[-1][1].shape[0]),
            _value("estimate", checkpoint.estimator[-1][1].shape[0]),
        ],
        weights,
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION,
        producer_name="rmll-export",
    )  # fmt: skip
    onnx.checker.check_model(model, full_check=True)
    return model


def _mlp(
    name: str, layers: Layers, source: str, target: str,
    nodes: list[onnx.NodeProto], weights: list[onnx.TensorProto],
) -> None:  # fmt: skip
    """Append a multi-layer perceptron with ReLU between its layers."""
    value = source
    for index, (weight, bias) in enumerate(layers):
        last = index == len(layers) - 1
        weight_name, bias_name = f"{name}.{index}.weight", f"{name}.{index}.bias"
        weights.append(numpy_helper.from_array(weight.astype(np.float32), weight_name))
        weights.append(numpy_helper.from_array(bias.astype(np.float32), bias_name))
        out = target if last else f"{name}.{index}.linear"
        nodes.append(helper.make_node("Gemm", [value, weight_name, bias_name], [out], transB=1))
        if not last:
            value = f"{name}.{index}.relu"
            nodes.append(helper.make_node("Relu", [out], [value]))


def _add_mirror_mask(
    fold: MirrorFold, nodes: list[onnx.NodeProto], weights: list[onnx.TensorProto]
) -> None:
    """``turned`` (1, 1), Boolean: the observation's state is one that is turned."""
    mask = np.zeros((len(fold.mirrors["observation"][0]), 1), np.float32)
    mask[: len(fold.turned_states), 0] = fold.turned_states
    weights.append(numpy_helper.from_array(mask, "turned_states"))
    weights.append(numpy_helper.from_array(np.array([[0.5]], np.float32), "half"))
    nodes.append(helper.make_node("MatMul", ["observation", "turned_states"], ["share"]))
    nodes.append(helper.make_node("Greater", ["share", "half"], ["turned"]))


def _mirrored(
    fold: MirrorFold, name: str, source: str, target: str,
    nodes: list[onnx.NodeProto], weights: list[onnx.TensorProto],
) -> None:  # fmt: skip
    """target = the image of source where turned, else source"""
    index, sign = fold.mirrors[name]
    weights.append(numpy_helper.from_array(index, f"{name}.source"))
    weights.append(numpy_helper.from_array(sign, f"{name}.sign"))
    swapped, image = f"{name}.swapped", f"{name}.image"
    nodes += [
        helper.make_node("Gather", [source, f"{name}.source"], [swapped], axis=1),
        helper.make_node("Mul", [swapped, f"{name}.sign"], [image]),
        helper.make_node("Where", ["turned", image, source], [target]),
    ]


def _value(name: str, width: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, width])


def _scales(contract: Contract) -> np.ndarray:
    return np.concatenate(
        [np.full(field.size, field.scale, np.float32) for field in contract.estimates]
    )
