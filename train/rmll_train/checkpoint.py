"""The two files of a run: one to go on training, one to export.

``checkpoint.pt`` holds everything a resumed run needs (tensors and plain values; it is read with
``weights_only``). ``policy.safetensors`` holds the networks that the robot needs, and in its header
the contract, so that export works without torch. Both are replaced atomically.
"""

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

import torch
from safetensors.torch import save

from rmll_common.errors import InputError
from rmll_contract.contract import KEY, Labels, Trace, describe, encode, seal
from rmll_train.env.environment import EnvironmentState, GaitEnv
from rmll_train.learning.actor_critic import EstimatingActor
from rmll_train.learning.gait_ppo import LearnerState
from rmll_train.learning.network_symmetry import NetworkSymmetry
from rmll_train.provenance import Provenance

CHECKPOINT = "checkpoint.pt"
POLICY = "policy.safetensors"
PROBES = 64
"""Random observations whose answers travel along, for the exporter to check itself against"""
PROBE_SPREAD = 0.5
"""Their standard deviation, about that of real observations with the layout's scales"""

_KINDS = {"learner": dict, "environment": dict, "random": torch.Tensor, "steps": int,
          "seconds": float, "provenance": dict}  # fmt: skip
"""What is checked of a checkpoint; the rest shows when it is restored"""


class CheckpointState(TypedDict):
    """Everything a resumed run needs."""

    learner: LearnerState
    environment: EnvironmentState
    rules: NotRequired[str]
    """Digest of the gait's; older checkpoints do not tell them"""
    random: torch.Tensor
    """torch's own state of it"""
    steps: int
    seconds: float
    """of training, all sessions of the run together"""
    provenance: Provenance


def save_checkpoint(run: Path, state: CheckpointState) -> None:
    _replace(run / CHECKPOINT, lambda path: torch.save(state, path))


def load_checkpoint(run: Path) -> CheckpointState:
    """Raises InputError with one line when the file is missing or no checkpoint."""
    path = run / CHECKPOINT
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint; --resume takes the folder of a run")
    try:
        saved = torch.load(path, weights_only=True)
    # a file that was cut short is, to torch, an invalid argument of the system
    except (RuntimeError, EOFError, OSError, pickle.UnpicklingError, ValueError) as error:
        raise InputError(f"{path}: not a checkpoint of rmll-train") from error
    if not isinstance(saved, dict) or not all(
        isinstance(saved.get(name), kind) for name, kind in _KINDS.items()
    ):
        raise InputError(f"{path}: not a checkpoint of rmll-train")
    return cast(CheckpointState, saved)


def save_policy(
    run: Path, actor: EstimatingActor, env: GaitEnv, trace: Trace, provenance: Provenance
) -> None:
    """Write ``policy.safetensors``: layers ``policy.i.weight``/``bias`` and ``estimator.i.*``, and
    ``fold.*`` if the policy is folded."""
    tensors = _layers("policy", actor.mlp) | _layers("estimator", actor.estimator)
    generator = torch.Generator().manual_seed(0)
    probe = PROBE_SPREAD * torch.randn(PROBES, actor.obs_dim, generator=generator)
    states = env.table.num_states
    probe[:, :states] = torch.eye(states)[torch.arange(PROBES) % states]
    with torch.no_grad():
        answers = {"probe.estimate": actor.estimate(probe), "probe.action": actor.mean(probe)}
    tensors |= {"probe.observation": probe, **answers, **_fold(actor.fold)}
    labels = Labels(env.world.contact_force, env.world.clearance)
    contract = describe(env.robot, env.table, env.world.profile, labels, provenance, trace)
    header = {KEY: encode(seal(contract))}
    # save_file would make a file that its owner alone can read
    content = save(tensors, metadata=header)
    _replace(run / POLICY, lambda path: path.write_bytes(content))


def _layers(name: str, network: torch.nn.Module) -> dict[str, torch.Tensor]:
    linear = [layer for layer in network.modules() if isinstance(layer, torch.nn.Linear)]
    return {
        f"{name}.{index}.{kind}": getattr(layer, kind).detach().clone()
        for index, layer in enumerate(linear)
        for kind in ("weight", "bias")
    }


def _fold(fold: NetworkSymmetry) -> dict[str, torch.Tensor]:
    """Which states are turned, and the mirrors; nothing where no state is."""
    if not fold.used:
        return {}
    mirrors = {"observation": fold.observation, "action": fold.action, "estimate": fold.estimate}
    return {"fold.turned_states": fold.turned_states.clone()} | {
        f"fold.{name}.{part}": getattr(mirror, part).clone()
        for name, mirror in mirrors.items()
        for part in ("source", "sign")
    }


def _replace(path: Path, write: Callable[[Path], Any]) -> None:
    """A reader sees the old file or the new one, never half of one, even after a power cut."""
    partial = path.with_name(path.name + ".partial")
    write(partial)
    with partial.open("rb") as file:
        os.fsync(file.fileno())
    partial.replace(path)
