"""Finding and reading a trained policy: weights in safetensors, the contract in its header.

Needs neither torch nor the trainer.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from rmll_contract import contract as contracts
from rmll_contract.contract import Contract
from rmll_gaits.errors import InputError

MAX_BYTES = 64 * 1024 * 1024
Weights = NDArray[np.float32]
Layers = list[tuple[Weights, Weights]]
"""(weight (out, in), bias (out,)) a layer"""


@dataclass(frozen=True)
class Fold:
    """Mirrors of a policy that sees half of its gait's states (``train/rmll_train/folding.py``).

    The image of a vector is ``vector[source] * sign``.
    """

    turned_states: Weights
    """(states,) 1 for states whose observation is mirrored, 0 for the others"""
    mirrors: dict[str, tuple[NDArray[np.int64], Weights]]
    """(source, sign) of ``observation``, ``action`` and ``estimate``"""


@dataclass(frozen=True)
class Checkpoint:
    """A policy as the trainer left it."""

    source: Path
    contract: Contract
    estimator: Layers
    policy: Layers
    fold: Fold | None
    probe_observation: Weights
    """(n, size) random observations, and the learner's own answers to them"""
    probe_estimate: Weights
    probe_action: Weights


def find(gait: str, runs: Path, shipped: Path) -> Path:
    """The newest finished run of ``gait``, else its shipped checkpoint; InputError if neither."""
    if newest := newest_run(gait, runs):
        return newest
    path = shipped / f"{gait}.safetensors"
    if path.is_file():
        return path
    names = {path.stem for path in shipped.glob("*.safetensors")}
    names |= {path.name for path in runs.glob("*")}
    raise InputError(
        f"no finished run of {gait!r} in {runs}/ and no {path}; "
        f"there is: {', '.join(sorted(names)) or 'none'}"
    )


def newest_run(gait: str, runs: Path) -> Path | None:
    """The policy of the newest finished run of ``gait``, None without one."""
    finished = sorted(
        (result.stat().st_mtime, result.with_name("policy.safetensors"))
        for result in (runs / gait).glob("*/result.yaml")
    )
    return finished[-1][1] if finished else None


def read(path: Path) -> Checkpoint:
    """Raises InputError in one line for a file that is missing or no checkpoint."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MB, not a checkpoint")
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except SafetensorError as error:
        raise InputError(f"{path}: not a safetensors file: {error}") from error
    if contracts.KEY not in metadata:
        raise InputError(f"{path}: not a checkpoint of rmll-train: no {contracts.KEY!r} header")
    contract = contracts.decode(metadata[contracts.KEY], path.name)
    try:
        return Checkpoint(
            path,
            contract,
            _layers(tensors, "estimator"),
            _layers(tensors, "policy"),
            _fold(tensors),
            *(tensors[f"probe.{name}"] for name in ("observation", "estimate", "action")),
        )
    except KeyError as error:
        raise InputError(f"{path}: tensor {error} is missing") from error


def _layers(tensors: dict[str, Weights], name: str) -> Layers:
    count = sum(key.startswith(f"{name}.") and key.endswith(".weight") for key in tensors)
    if not count:
        raise KeyError(f"{name}.0.weight")
    return [(tensors[f"{name}.{i}.weight"], tensors[f"{name}.{i}.bias"]) for i in range(count)]


def _fold(tensors: dict[str, Weights]) -> Fold | None:
    if "fold.turned_states" not in tensors:
        return None
    mirrors = {
        name: (tensors[f"fold.{name}.source"].astype(np.int64), tensors[f"fold.{name}.sign"])
        for name in ("observation", "action", "estimate")
    }
    return Fold(tensors["fold.turned_states"], mirrors)
