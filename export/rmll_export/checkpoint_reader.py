"""Reading a trained policy: weights in safetensors, the contract in its header.

Needs neither torch nor the trainer.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from rmll_common.errors import InputError
from rmll_contract import contract as contracts
from rmll_contract.contract import Contract

MAX_BYTES = 64 * 1024 * 1024
Weights = NDArray[np.float32]
Layers = list[tuple[Weights, Weights]]
"""(weight (out, in), bias (out,)) a layer"""


@dataclass(frozen=True)
class MirrorFold:
    """Mirrors of a policy that sees half of its gait's states.

    Made by ``train/rmll_train/learning/network_symmetry.py``.

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
    fold: MirrorFold | None
    probe_observation: Weights
    """(n, size) random observations, and the learner's own answers to them"""
    probe_estimate: Weights
    probe_action: Weights


class Origin(msgspec.Struct, frozen=True):
    """The part of a contract that tells which policy this is."""

    gait: str
    table: dict[str, object]
    provenance: dict[str, Any]


def read(path: Path) -> Checkpoint:
    """Raises InputError in one line for a file that is missing or no checkpoint."""
    with _opened(path) as file:
        header = _header(file, path)
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    contract = contracts.decode(header, path.name)
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


def origin(path: Path) -> Origin:
    """What a checkpoint says about itself, without its weights; errors as :func:`read`."""
    with _opened(path) as file:
        header = _header(file, path)
    try:
        return msgspec.json.decode(header, type=Origin)
    except msgspec.DecodeError as error:
        raise InputError(f"{path}: the contract cannot be read: {error}") from error


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    if path.is_dir():  # of which safetensors has a number to say
        raise InputError(f"{path}: a folder, expected a policy.safetensors")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES >> 20} MB, not a checkpoint")
        with safe_open(path, framework="numpy") as file:
            yield file
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except SafetensorError as error:
        raise InputError(f"{path}: not a safetensors file: {error}") from error


def _header(file: Any, path: Path) -> str:
    metadata = file.metadata() or {}
    if contracts.KEY not in metadata:
        raise InputError(f"{path}: not a checkpoint of rmll-train: no {contracts.KEY!r} header")
    return metadata[contracts.KEY]


def _layers(tensors: dict[str, Weights], name: str) -> Layers:
    count = sum(key.startswith(f"{name}.") and key.endswith(".weight") for key in tensors)
    if not count:
        raise KeyError(f"{name}.0.weight")
    return [(tensors[f"{name}.{i}.weight"], tensors[f"{name}.{i}.bias"]) for i in range(count)]


def _fold(tensors: dict[str, Weights]) -> MirrorFold | None:
    if "fold.turned_states" not in tensors:
        return None
    mirrors = {
        name: (tensors[f"fold.{name}.source"].astype(np.int64), tensors[f"fold.{name}.sign"])
        for name in ("observation", "action", "estimate")
    }
    return MirrorFold(tensors["fold.turned_states"], mirrors)
