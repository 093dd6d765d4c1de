"""A bundle whose policy always answers zero: the robot stands in its default pose."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import msgspec
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from rmll_contract import contract as contracts
from rmll_contract import observation
from rmll_contract.contract import Labels, Trace
from rmll_contract.onnx_file import graph_sha256
from rmll_gaits.load import load_gait
from rmll_hil.faults.empty_loop import EmptyLoop
from rmll_robots import A1


def standing_policy(inputs: int) -> onnx.ModelProto:
    nodes, weights, outputs = [], [], []
    for name, size in (("action", 12), ("estimate", 7)):
        weights.append(numpy_helper.from_array(np.zeros((inputs, size), np.float32), f"w_{name}"))
        nodes.append(helper.make_node("MatMul", ["observation", f"w_{name}"], [name]))
        outputs.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, size]))
    observed = helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, inputs])
    graph = helper.make_graph(nodes, "standing", [observed], outputs, weights)
    opset = helper.make_opsetid("", 17)
    return helper.make_model(graph, ir_version=9, opset_imports=[opset])


def first_step(layout: observation.Layout, states: int) -> Trace:
    """The golden trace of one step: all feet down in the default pose, without a command."""
    pose, zeros, gravity, command = A1.default_pose, np.zeros(12), [0.0, 0.0, -1.0], [0.0, 0.0, 9.0]
    parts = dict.fromkeys((field.name for field in layout), 0.0)
    parts |= {"rm_state": np.eye(states)[0], "projected_gravity": gravity, "command_frequency": 9.0}
    parts = {name: np.asarray(value) for name, value in parts.items()}
    observed = observation.write(np.zeros(observation.size(layout)), layout, parts)
    return Trace(
        touching=[[True] * 4],
        clear=[[False] * 4],
        joint_position=[pose.tolist()],
        joint_velocity=[zeros.tolist()],
        projected_gravity=[gravity],
        angular_velocity=[[0.0] * 3],
        command=[command],
        label=[15],
        state=[0],
        phi=[0],
        observation=[observed.tolist()],
        estimate=[[0.0] * 7],
        action=[zeros.tolist()],
        target=[pose.tolist()],
    )


@pytest.fixture(scope="session")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    table = load_gait("trot")
    layout = observation.layout("imu", table.num_states)
    model = standing_policy(observation.size(layout))
    labels = Labels(contact_force=1.0, clearance=0.03)
    trace = first_step(layout, table.num_states)
    contract = msgspec.structs.replace(
        contracts.describe(A1, table, "imu", labels, {}, trace),
        graph_sha256=graph_sha256(model.SerializeToString()),
    )
    sealed = contracts.encode(contracts.seal(contract))
    helper.set_model_props(model, {contracts.KEY: sealed})
    path = tmp_path_factory.mktemp("bundle") / "standing.onnx"
    path.write_bytes(model.SerializeToString())
    return path


BUSY_MS = 5.0
"""[ms] A control period; on a machine with a core to spare an empty loop is late by less"""


@contextmanager
def _kept_time() -> Iterator[None]:
    failed = None
    with EmptyLoop() as beside:
        try:
            yield
        except AssertionError as error:
            failed = error
    if failed is not None and beside.late_ms < BUSY_MS:
        raise failed


@pytest.fixture
def kept_time() -> Callable[[], AbstractContextManager[None]]:
    """A block whose assertions hold on a machine that has time for it.

    An empty loop is measured beside it: that a walk in real time went wrong says something about
    the walk only if that kept time.
    """
    return _kept_time
