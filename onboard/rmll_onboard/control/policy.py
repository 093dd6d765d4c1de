"""Running the network: one thread, no copies but the observation's."""

import numpy as np
import onnxruntime
from numpy.typing import NDArray

OBSERVATION, ACTION, ESTIMATE = "observation", "action", "estimate"
"""Names of the graph's input and outputs, each float32 (1, size)"""


def open_session(model: bytes) -> onnxruntime.InferenceSession:
    """Session over a serialised ONNX model; raises onnxruntime's exceptions if it is none."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


class Policy:
    """The estimator and policy of a bundle, bound to its own arrays."""

    def __init__(self, session: onnxruntime.InferenceSession) -> None:
        """The session's input and outputs must be as named above, of fixed size."""
        arrays = {
            value.name: np.zeros(value.shape, np.float32)
            for value in [*session.get_inputs(), *session.get_outputs()]
        }
        self._session = session
        self._binding = session.io_binding()
        self._input = arrays[OBSERVATION]
        self._action = arrays[ACTION][0]
        self._estimate = arrays[ESTIMATE][0]
        for bind, name in (
            (self._binding.bind_input, OBSERVATION),
            (self._binding.bind_output, ACTION),
            (self._binding.bind_output, ESTIMATE),
        ):
            array = arrays[name]
            bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)

    def run(
        self, observation: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Action and estimate for an observation, each (size,), valid until the next call."""
        self._input[0] = observation
        self._session.run_with_iobinding(self._binding)
        return self._action, self._estimate
