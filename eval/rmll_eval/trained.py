"""Walks in the trainer's world, all at once. Needs torch."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import onnx
import torch
from onnx import numpy_helper
from tensordict import TensorDict
from torch import Tensor, nn

from rmll_contract.mirror import Mirror
from rmll_eval.trial import Trial
from rmll_eval.walk import Walk
from rmll_gaits.errors import InputError
from rmll_hil.metrics import cost_of_transport
from rmll_onboard.bundle import Bundle, load_bundle
from rmll_train.environment import GaitEnv
from rmll_train.evaluation import evaluate
from rmll_train.folding import Reflected
from rmll_train.settings import Ground, World

_SETTLING = 2.0
"""[s] by which an episode is longer than the walk, so that none ends during it for its age"""


def walks(bundle: Path, trials: Sequence[Trial], seconds: float) -> Iterator[Walk]:
    """One robot a trial, each with its own noise, friction, mass, delay and pushes, which all come
    from the first trial's seed.

    The world is that of the policy's training, its ground flat. Every early end of an episode
    counts as a fall; the robot then starts anew.
    """
    loaded = load_bundle(bundle)
    robot, hz = loaded.robot, loaded.robot.policy_hz
    world = replace(_world(loaded), envs=len(trials), episode=seconds + _SETTLING, ground=Ground())
    env = GaitEnv(loaded.table, robot, world, trials[0].seed)
    env.demands.strict = True  # whoever has learned the gait is measured by all of its rules
    env.fix_commands(torch.tensor([[t.vx, t.wz, t.frequency] for t in trials]))
    tally = evaluate(actor(bundle), env, round(seconds * hz))
    for index, trial in enumerate(trials):
        own = tally.robot(index)
        found = own.metrics()
        energy = found["energy_per_metre"]
        yield Walk(
            trial,
            adherence=found["adherence"],
            off_spec_contact=found["off_spec_contact"],
            vx_error=found["vx_error"],
            wz_error=found["wz_error"],
            energy_per_metre=energy,
            cost_of_transport=cost_of_transport(energy, robot),
            distance=float(own.distance),
            falls=int(own.ends),
        )


def actor(bundle: Path) -> Callable[[TensorDict], Tensor]:
    """The bundle's graph, whose batch is fixed to one robot, for many: observation to action."""
    graph = onnx.load(bundle).graph
    weights = {w.name: torch.from_numpy(numpy_helper.to_array(w).copy()) for w in graph.initializer}
    estimator, policy = _mlp(weights, "estimator"), _mlp(weights, "policy")
    scale = weights["estimate_scale"]

    def answer(own: Tensor) -> Tensor:
        return policy(torch.cat([own, estimator(own) * scale], dim=-1))

    def folded(own: Tensor) -> Tensor:
        turned = own @ weights["turned_states"]
        seen = _reflected(weights, "observation")(own, turned)
        return _reflected(weights, "action")(answer(seen), turned)

    act = folded if "turned_states" in weights else answer
    return lambda observed: act(observed["policy"])


def _reflected(weights: dict[str, Tensor], name: str) -> Reflected:
    """The trainer's own folding, with the mirror that the bundle carries."""
    return Reflected(Mirror(weights[f"{name}.source"].numpy(), weights[f"{name}.sign"].numpy()))


def _mlp(weights: dict[str, Tensor], name: str) -> nn.Sequential:
    """Layers NAME.0, NAME.1, ... with ELU between them, as ``rmll_export.graph`` writes them."""
    layers: list[nn.Module] = []
    while (weight := weights.get(f"{name}.{len(layers) // 2}.weight")) is not None:
        linear = nn.Linear(weight.shape[1], weight.shape[0])
        bias = weights[f"{name}.{len(layers) // 2}.bias"]
        linear.load_state_dict({"weight": weight, "bias": bias})
        layers += [linear, nn.ELU()]
    return nn.Sequential(*layers[:-1])


def _world(bundle: Bundle) -> World:
    """The world of the policy's training; settings that are newer than the policy are at their
    defaults."""
    settings = bundle.contract.provenance.get("settings", {})
    try:
        return msgspec.convert(settings.get("world", {}), World)
    except msgspec.ValidationError as error:
        raise InputError(f"{bundle.source}: its training settings: {error}") from error
