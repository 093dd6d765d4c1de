"""Steps a second of learning in bfloat16, in float32, and as ``learner.bf16: auto`` chooses.

    python tests/benchmarks/bench_precision.py

On this processor, and on one with AVX2 only, whose instructions are all that torch may use then.
Each kind is one process, in which the three runs take turns, update by update, so that what else
the machine does meets all three alike. On an idle machine; about two minutes.
"""

import json
import os
import statistics
import subprocess
import sys
from dataclasses import replace

KINDS = {
    "this processor": {},
    "AVX2 only": {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"},
}
CHOICES = ("auto", True, False)
UPDATES = 12
WARM_UP = 3


def main() -> None:
    print(f"{'':16} {'auto is':9} {'auto':>8} {'bf16':>8} {'float32':>8}  auto / the better one")
    for kind, environment in KINDS.items():
        call = [sys.executable, __file__, "child"]
        done = subprocess.run(
            call, env=os.environ | environment, stdout=subprocess.PIPE, text=True, check=True
        )
        chosen, auto, coarse, exact = json.loads(done.stdout)
        ratio = auto / max(coarse, exact)
        print(f"{kind:16} {chosen:9} {auto:8,.0f} {coarse:8,.0f} {exact:8,.0f}  {ratio:.2f}")


def child() -> None:
    """Print what auto chose and the three rates [environment steps/s]."""
    from rmll_gaits.load import load_gait
    from rmll_train.settings import Settings
    from rmll_train.training import Run

    default, gait = Settings(), load_gait("trot")
    runs = [
        Run(replace(default, learner=replace(default.learner, bf16=choice)), gait)
        for choice in CHOICES
    ]
    rates = [[run.update().rate for run in runs] for _ in range(WARM_UP + UPDATES)][WARM_UP:]
    chosen = "bf16" if runs[0].precision.bf16 else "float32"
    print(json.dumps([chosen, *map(statistics.median, zip(*rates, strict=True))]))


if __name__ == "__main__":
    child() if "child" in sys.argv else main()
