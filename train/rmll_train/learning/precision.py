"""Matrix products in bfloat16 or float32: whichever this processor is faster with.

Processors with AMX or AVX512-BF16 halve their time in bfloat16. Those with AVX2 only, most laptops,
take five to thirty times as long, and torch does not say so.
"""

import time
from dataclasses import dataclass

import torch
from rsl_rl.modules import MLP

from rmll_train.train_settings import TrainSettings

ROUNDS = 5
LEAST_GAIN = 1.1
"""bfloat16 is less exact, so it has to be so many times faster"""


@dataclass(frozen=True)
class Precision:
    """How matrix products are done, and how that was decided."""

    bf16: bool
    gain: float | None
    """Time of a mini-batch in float32 over that in bfloat16, here; None if it was not measured"""

    def __str__(self) -> str:
        name = "bfloat16" if self.bf16 else "float32"
        if self.gain is None:
            return f"matrix products in {name}, as the settings say"
        share = 1 / self.gain
        return f"matrix products in {name}: bfloat16 takes {share:.2f} of float32's time here"


def choose(settings: TrainSettings) -> Precision:
    """What ``learner.bf16`` says; "auto" is found out in a fraction of a second."""
    wanted = settings.learner.bf16
    if wanted != "auto":
        return Precision(wanted, None)
    gain = _gain(settings)
    return Precision(gain >= LEAST_GAIN, gain)


def _gain(settings: TrainSettings) -> float:
    learner = settings.learner
    rows = max(1, settings.world.envs * learner.rollout // learner.mini_batches)
    generator = torch.Generator().manual_seed(0)
    inputs = torch.randn(rows, 64, generator=generator)
    with torch.random.fork_rng():  # a run's own random numbers do not depend on this
        network = MLP(64, 12, learner.hidden, "relu")

    def seconds(bf16: bool) -> float:
        began = time.perf_counter()
        with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            network(inputs).float().square().mean().backward()
        return time.perf_counter() - began

    # in turn, and the least of each: another program may take the processor now and then
    rounds = [(seconds(False), seconds(True)) for _ in range(ROUNDS)]
    exact, coarse = (min(times) for times in zip(*rounds, strict=True))
    return exact / coarse
