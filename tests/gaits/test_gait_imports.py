import subprocess
import sys

import pytest

FORBIDDEN = ("lark", "yaml", "torch", "mujoco", "onnx", "onnxruntime", "matplotlib", "rich")


@pytest.mark.parametrize("module", ["table", "machine", "label", "pose", "schedule"])
def test_what_the_robot_needs_loads_no_more_than_numpy(module):
    program = (
        f"import sys, rmll_gaits.{module}\n"
        f"print(*({{name.partition('.')[0] for name in sys.modules}} & set({FORBIDDEN!r})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []
