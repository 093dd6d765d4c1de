"""A policy that goes wrong on purpose: a shipped bundle, altered and sealed again.

As long as its inputs are sane it is the policy that it was made from, so that it can be proved.
"""

from pathlib import Path

import msgspec
import numpy as np

from rmll_common.errors import Failure
from rmll_contract import contract as contracts
from rmll_contract.onnx_file import graph_sha256
from rmll_onboard.control.policy import ACTION, OBSERVATION

SANE = 100.0
"""An observation beyond it sets it off"""


def write(path: Path, policy: Path, answer: float) -> None:
    """Make ``path`` of the bundle ``policy``; set off, all its actions are ``answer``.

    Raises Failure without the onnx package.
    """
    try:
        import onnx
        from onnx import helper, numpy_helper
    except ModuleNotFoundError as error:
        raise Failure("onnx is not installed; run: pip install 'rmll[export]'") from error
    model = onnx.load(str(policy))
    graph, healthy = model.graph, f"healthy_{ACTION}"
    for node in graph.node:
        for names in (node.input, node.output):
            for at, name in enumerate(names):
                names[at] = healthy if name == ACTION else name
    size = next(out for out in graph.output if out.name == ACTION).type.tensor_type.shape.dim[1]
    answers = np.full((1, size.dim_value), answer, np.float32)
    graph.initializer.extend(
        [
            numpy_helper.from_array(np.array(SANE, np.float32), "sane"),
            numpy_helper.from_array(answers, "answers"),
        ]
    )
    graph.node.extend(
        [
            helper.make_node("Abs", [OBSERVATION], ["sizes"]),
            helper.make_node("ReduceMax", ["sizes"], ["largest"]),
            helper.make_node("Greater", ["largest", "sane"], ["insane"]),
            helper.make_node("Where", ["insane", "answers", healthy], [ACTION]),
        ]
    )
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    contract = contracts.decode(metadata[contracts.KEY], policy.name)
    digest = graph_sha256(model.SerializeToString())
    contract = contracts.seal(msgspec.structs.replace(contract, graph_sha256=digest))
    helper.set_model_props(model, metadata | {contracts.KEY: contracts.encode(contract)})
    path.write_bytes(model.SerializeToString())
