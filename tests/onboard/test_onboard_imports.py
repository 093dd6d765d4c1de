"""The robot needs numpy, onnxruntime, pyyaml, msgspec and tyro, and nothing else."""

import pkgutil
import subprocess
import sys

import rmll_onboard

FOREIGN = ("torch", "mujoco", "onnx", "matplotlib", "lark", "rich", "safetensors", "rsl_rl", "mcap")


def test_a_fresh_interpreter_runs_without_the_extras():
    modules = [
        f"rmll_onboard.{module.name}" for module in pkgutil.iter_modules(rmll_onboard.__path__)
    ]
    assert "rmll_onboard.cli" in modules
    program = (
        "import sys\n"
        f"sys.modules.update(dict.fromkeys({FOREIGN!r}))\n"  # importing one of them now fails
        f"import {', '.join(modules)}\n"
        f"print([name for name in {FOREIGN!r} if sys.modules[name] is not None])\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (result.stdout, result.stderr) == ("[]\n", "")
