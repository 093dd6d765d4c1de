"""Steps a second of learning with choices that depend on the processor, on two kinds of it.

    python tests/benchmarks/bench_precision.py

On this processor, and on one with AVX2 only, whose instructions are all that torch may use then.
Each kind is one process, in which the runs take turns, update by update, so that what else the
machine does meets all alike. On an idle machine; about three minutes.
"""

import json
import os
import statistics
import subprocess
import sys
from typing import Any

KINDS = {
    "this processor": {},
    "AVX2 only": {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"},
}
CHOICES: dict[str, dict[str, Any]] = {
    "bf16: auto (default)": {},
    "bf16: true": {"bf16": True},
    "bf16: false": {"bf16": False},
    "critic_epochs: 2": {"critic_epochs": 2},
    "rollout: 24": {"rollout": 24},
    "mini_batches: 8": {"mini_batches": 8},
}
"""What differs from the default settings' learner"""
UPDATES = 12
WARM_UP = 3


def main() -> None:
    found = {}
    for kind, environment in KINDS.items():
        call = [sys.executable, __file__, "child"]
        done = subprocess.run(
            call, env=os.environ | environment, stdout=subprocess.PIPE, text=True, check=True
        )
        found[kind] = json.loads(done.stdout)
    print(f"{'[environment steps/s]':24}", *(f"{kind:>16}" for kind in KINDS))
    for choice in CHOICES:
        print(f"{choice:24}", *(f"{found[kind]['rates'][choice]:16,.0f}" for kind in KINDS))
    for kind, told in found.items():
        rates = [told["rates"][f"bf16: {choice}"] for choice in ("auto (default)", "true", "false")]
        ratio = rates[0] / max(rates[1:])
        print(f"{kind}: auto is {told['chosen']}, {ratio:.2f} of the better of true and false")


def child() -> None:
    """Print what auto chose and the median rate of each choice [environment steps/s]."""
    from rmll_gaits.load import load_gait
    from rmll_train.train_settings import TrainSettings, overlaid
    from rmll_train.training import Run

    gait = load_gait("trot")
    runs = {
        choice: Run(overlaid(TrainSettings(), {"learner": changed}, choice), gait)
        for choice, changed in CHOICES.items()
    }
    rounds = [[run.update().rate for run in runs.values()] for _ in range(WARM_UP + UPDATES)]
    rates = map(statistics.median, zip(*rounds[WARM_UP:], strict=True))
    chosen = "bfloat16" if runs["bf16: auto (default)"].precision.bf16 else "float32"
    print(json.dumps({"chosen": chosen, "rates": dict(zip(runs, rates, strict=True))}))


if __name__ == "__main__":
    child() if "child" in sys.argv else main()
