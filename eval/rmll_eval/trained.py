"""Walks in the trainer's world, all at once. Needs torch."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import msgspec
import onnx
import torch
from onnx import numpy_helper
from tensordict import TensorDict
from torch import Tensor, nn

from rmll_common.errors import InputError
from rmll_contract.mirror import Mirror
from rmll_eval.conditions import PUSH_INTERVAL, PUSH_VELOCITY, Conditions
from rmll_eval.evaluation_case import EvaluationCase
from rmll_eval.walk_metrics import WalkMetrics
from rmll_hil.runs.metrics import cost_of_transport
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_robots.ground import course
from rmll_train.env.environment import GaitEnv
from rmll_train.learning.network_symmetry import Mirrored
from rmll_train.periodic_evaluation import evaluate
from rmll_train.train_settings import EnvSettings, GroundSettings

_SETTLING = 2.0
"""[s] by which an episode is longer than the walk, so that none ends during it for its age"""
_ACTIVATIONS = {"Relu": nn.ReLU, "Elu": nn.ELU}
"""Node types that a network's layers may have between them; the older bundles have Elu"""


def walks(
    bundle: Path, trials: Sequence[EvaluationCase], seconds: float, conditions: Conditions
) -> Iterator[WalkMetrics]:
    """One robot a trial, each with its own noise, friction, mass, delay and pushes, which all come
    from the first trial's seed, as does the ground, which they share.

    The world is that of the policy's training under these ``conditions``. Every early end of an
    episode counts as a fall; the robot then starts anew.
    """
    loaded = load_bundle(bundle)
    robot, hz = loaded.robot, loaded.robot.policy_hz
    world = replace(
        _under(conditions, _world(loaded)), envs=len(trials), episode=seconds + _SETTLING
    )
    env = GaitEnv(loaded.table, robot, world, trials[0].seed)
    env.fix_commands(torch.tensor([[t.vx, t.wz, t.frequency] for t in trials]))
    sums = evaluate(actor(bundle), env, round(seconds * hz))
    for index, trial in enumerate(trials):
        own = sums.robot(index)
        found = own.metrics()
        energy = found["energy_per_metre"]
        yield WalkMetrics(
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
    estimator, policy = _mlp(graph, weights, "estimator"), _mlp(graph, weights, "policy")
    scale = weights["estimate_scale"]

    def answer(own: Tensor) -> Tensor:
        return policy(torch.cat([own, estimator(own) * scale], dim=-1))

    def folded(own: Tensor) -> Tensor:
        turned = own @ weights["turned_states"]
        seen = _mirrored(weights, "observation")(own, turned)
        return _mirrored(weights, "action")(answer(seen), turned)

    act = folded if "turned_states" in weights else answer
    return lambda observed: act(observed["policy"])


def _mirrored(weights: dict[str, Tensor], name: str) -> Mirrored:
    """The trainer's own folding, with the mirror that the bundle carries."""
    return Mirrored(Mirror(weights[f"{name}.source"].numpy(), weights[f"{name}.sign"].numpy()))


def _mlp(graph: onnx.GraphProto, weights: dict[str, Tensor], name: str) -> nn.Sequential:
    """The layers of one network and what is between them, as ``rmll_export.graph`` writes them:
    nodes in their order, whose inputs begin with the network's name."""
    layers: list[nn.Module] = []
    for node in graph.node:
        if node.op_type == "Gemm" and node.input[1].startswith(f"{name}."):
            weight, bias = (weights[key] for key in node.input[1:])
            linear = nn.Linear(weight.shape[1], weight.shape[0])
            linear.load_state_dict({"weight": weight, "bias": bias})
            layers.append(linear)
        elif node.input[0].startswith(f"{name}."):
            layers.append(_activation(node.op_type))
    return nn.Sequential(*layers)


def _activation(kind: str) -> nn.Module:
    if kind not in _ACTIVATIONS:
        raise InputError(
            f"the policy's graph has {kind} nodes, expected {' or '.join(_ACTIVATIONS)}"
        )
    return _ACTIVATIONS[kind]()


def _under(conditions: Conditions, world: EnvSettings) -> EnvSettings:
    """The world with the ground and the pushes that are wanted, instead of those of training."""
    ground = GroundSettings()
    if conditions.ground != "flat":
        ground = GroundSettings(**asdict(course(conditions.ground, conditions.level)))
    disturbed = replace(
        world.randomisation,
        push_interval=PUSH_INTERVAL,
        push_velocity=PUSH_VELOCITY if conditions.pushes else 0.0,
    )
    return replace(world, ground=ground, randomisation=disturbed)


def _world(bundle: Bundle) -> EnvSettings:
    """The world of the policy's training; settings that are newer than the policy are at their
    defaults."""
    settings = bundle.contract.provenance.get("settings", {})
    try:
        return msgspec.convert(settings.get("world", {}), EnvSettings)
    except msgspec.ValidationError as error:
        raise InputError(f"{bundle.source}: its training settings: {error}") from error
