"""Which products a run uses: what the settings say, or what this processor is faster with."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
import torch

from rmll_train.learning import precision
from rmll_train.learning.precision import Precision, choose
from rmll_train.train_settings import TrainSettings


def with_bf16(value: bool | str) -> TrainSettings:
    return replace(TrainSettings(), learner=replace(TrainSettings().learner, bf16=value))


@pytest.mark.parametrize("wanted", [True, False])
def test_what_the_settings_say_is_not_measured(wanted: bool) -> None:
    assert choose(with_bf16(wanted)) == Precision(wanted, None)


@pytest.mark.parametrize(("gain", "bf16"), [(2.0, True), (1.05, False), (0.1, False)])
def test_auto_takes_the_coarser_products_only_for_a_clear_gain(
    gain: float, bf16: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(precision, "_gain", lambda settings: gain)
    assert choose(with_bf16("auto")) == Precision(bf16, gain)


def test_measuring_leaves_the_runs_random_numbers_alone() -> None:
    torch.manual_seed(1)
    expected = torch.rand(3)
    torch.manual_seed(1)
    choose(with_bf16("auto"))
    assert torch.equal(torch.rand(3), expected)


def test_a_processor_without_bfloat16_gets_float32() -> None:
    """The instructions are taken away from torch; what is left is five times slower or more."""
    code = (
        "from rmll_train.train_settings import TrainSettings\n"
        "from rmll_train.learning.precision import choose\nprint(choose(TrainSettings()).bf16)"
    )
    without = os.environ | {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "avx2"}
    done = subprocess.run([sys.executable, "-c", code], env=without, capture_output=True, text=True)
    assert done.stdout.strip() == "False", done.stderr
