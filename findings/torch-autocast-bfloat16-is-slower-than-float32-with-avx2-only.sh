#!/usr/bin/env bash
# torch 2.13.0 (CPU), numpy 2.4.6, Linux x86-64, Python 3.11.
#
# torch.autocast("cpu", torch.bfloat16) is meant to make training faster. Where a processor has neither
# AMX nor AVX512-BF16, its products are emulated and take several times as long as in float32; torch
# neither warns nor falls back. ONEDNN_MAX_CPU_ISA=AVX2 and ATEN_CPU_CAPABILITY=avx2 take the
# instructions away from torch on any processor, so that it can be seen on one that has them.
#
# Measured: forward and backward of 3 x 256, batches of 3072, one thread, the least of 7 each.
# Seen on an EPYC of 2022 restricted so: float32 84 ms, bfloat16 777 ms, 9.2 times as long (other programs were running).
# Exits with 1 if bfloat16 is no longer slower by half.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check torch==2.13.0 numpy==2.4.6
export ONEDNN_MAX_CPU_ISA=AVX2 ATEN_CPU_CAPABILITY=avx2 OMP_NUM_THREADS=1
"$folder/venv/bin/python" - <<'PYTHON'
import sys
import time
import warnings

import torch

warnings.simplefilter("error")  # a warning would end this: there is none
sizes = (64, 256, 256, 256, 12)
layers = [part for i in range(4) for part in (torch.nn.Linear(sizes[i], sizes[i + 1]), torch.nn.ReLU())]
network, inputs = torch.nn.Sequential(*layers), torch.randn(3072, 64)


def seconds(bf16):
    began = time.perf_counter()
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        network(inputs).float().square().mean().backward()
    return time.perf_counter() - began


rounds = [(seconds(False), seconds(True)) for _ in range(7)]
exact, coarse = (min(times) for times in zip(*rounds))
print(f"float32 {exact * 1e3:.1f} ms, bfloat16 {coarse * 1e3:.1f} ms, {coarse / exact:.1f} times as long")
sys.exit(coarse < 1.5 * exact)
PYTHON
