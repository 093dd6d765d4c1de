"""The network as one ONNX graph: estimator, concatenation and policy inside, batch fixed to 1.

    observation (1, n) -> estimator -> estimate (1, 7)
    (observation, estimate * scale) -> policy -> action (1, 12)

Built node by node: for a few layers that is simpler than tracing, and it needs no torch.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from rmll_contract.contract import Contract
from rmll_export.checkpoint import Checkpoint, Layers

OPSET = 17
IR_VERSION = 9
"""Old enough for any onnxruntime since 1.16"""


def build(checkpoint: Checkpoint) -> onnx.ModelProto:
    """The model without metadata."""
    nodes: list[onnx.NodeProto] = []
    weights: list[onnx.TensorProto] = []
    _mlp("estimator", checkpoint.estimator, "observation", "estimate", nodes, weights)
    weights.append(numpy_helper.from_array(_scales(checkpoint.contract), "estimate_scale"))
    nodes.append(helper.make_node("Mul", ["estimate", "estimate_scale"], ["scaled_estimate"]))
    nodes.append(
        helper.make_node("Concat", ["observation", "scaled_estimate"], ["policy_input"], axis=1)
    )
    _mlp("policy", checkpoint.policy, "policy_input", "action", nodes, weights)
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
    """Append a multi-layer perceptron with ELU between its layers."""
    value = source
    for index, (weight, bias) in enumerate(layers):
        last = index == len(layers) - 1
        weight_name, bias_name = f"{name}.{index}.weight", f"{name}.{index}.bias"
        weights.append(numpy_helper.from_array(weight.astype(np.float32), weight_name))
        weights.append(numpy_helper.from_array(bias.astype(np.float32), bias_name))
        out = target if last else f"{name}.{index}.linear"
        nodes.append(helper.make_node("Gemm", [value, weight_name, bias_name], [out], transB=1))
        if not last:
            value = f"{name}.{index}.elu"
            nodes.append(helper.make_node("Elu", [out], [value], alpha=1.0))


def _value(name: str, width: int) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, width])


def _scales(contract: Contract) -> np.ndarray:
    return np.concatenate(
        [np.full(field.size, field.scale, np.float32) for field in contract.estimates]
    )
