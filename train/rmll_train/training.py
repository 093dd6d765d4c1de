"""One training run: from settings to a folder with checkpoints, curves and a policy."""

import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import torch
from torch.utils.tensorboard import SummaryWriter

from rmll_gaits.load import load_gait
from rmll_robots import A1
from rmll_train import settings as settings_file
from rmll_train.checkpoint import load_checkpoint, save_checkpoint, save_policy
from rmll_train.environment import GaitEnv
from rmll_train.evaluation import evaluate, golden_trace
from rmll_train.learner import GaitPPO
from rmll_train.settings import Settings

SETTINGS = "settings.yaml"
RESULT = "result.yaml"
"""Written last: a run that has it is finished"""
CHECKPOINT_SECONDS = 45.0
EVALUATION_STEPS = 500


@dataclass(frozen=True)
class Progress:
    """What a reporter is shown after every update."""

    steps: int
    total: int
    seconds: float
    """of training, all sessions of the run together"""
    rate: float
    """environment steps a second, learning included, over this update"""
    metrics: dict[str, float]


def train(run: Path, settings: Settings, report: Callable[[Progress], None], resume: bool) -> bool:
    """Train until ``settings.learner.steps``; returns False if Ctrl-C or SIGTERM ended it before.

    ``run`` then holds the settings, ``checkpoint.pt`` (at most a minute old at any time),
    ``policy.safetensors``, TensorBoard events and, when finished, ``result.yaml``.
    Raises Failure when training diverges; the last good checkpoint stays.
    """
    torch.manual_seed(settings.seed)
    table = load_gait(settings.gait)
    env = GaitEnv(table, A1, settings.world, settings.seed)
    learner = GaitPPO(env, settings.learner)
    done = _Clock()
    if resume:
        done = _restore(load_checkpoint(run), env, learner)
    run.mkdir(parents=True, exist_ok=True)
    (run / SETTINGS).write_text(settings_file.to_yaml(settings))

    with _Interrupt() as interrupt, SummaryWriter(str(run), purge_step=done.steps) as writer:
        finished = _loop(run, settings, env, learner, done, report, writer, interrupt)
    if finished:
        tally = evaluate(learner.actor, env, EVALUATION_STEPS)
        result = _provenance(settings, env, learner, done) | {"metrics": tally.metrics()}
        _save_policy(run, settings, env, learner, result)
        (run / RESULT).write_text(settings_file.yaml.safe_dump(result, sort_keys=False))
    return finished


@dataclass
class _Clock:
    steps: int = 0
    seconds: float = 0.0


def _loop(
    run: Path, settings: Settings, env: GaitEnv, learner: GaitPPO, done: _Clock,
    report: Callable[[Progress], None], writer: SummaryWriter, interrupt: "_Interrupt",
) -> bool:  # fmt: skip
    total, saved_at = settings.learner.steps, time.monotonic()
    obs = env.get_observations()
    while done.steps < total and not interrupt.asked:
        began = time.monotonic()
        with torch.inference_mode():
            for _ in range(settings.learner.rollout):
                obs, rewards, dones, extras = env.step(learner.act(obs))
                learner.process_env_step(obs, rewards, dones, extras)
            learner.compute_returns(obs)
        losses = learner.update()
        taken = env.num_envs * settings.learner.rollout
        elapsed = time.monotonic() - began
        done.steps += taken
        done.seconds += elapsed
        metrics = env.take_tally().metrics() | {
            "action_std": float(learner.actor.output_std.mean()),
            "learning_rate": learner.learning_rate,
            "failures": float(env.simulation.failures),
            "rejected_updates": float(learner.rejected_updates),
        }
        for name, value in metrics.items():
            writer.add_scalar(f"walk/{name}", value, done.steps)
        for name, value in losses.items():
            writer.add_scalar(f"loss/{name}", value, done.steps)
        report(Progress(done.steps, total, done.seconds, taken / elapsed, metrics))
        if time.monotonic() - saved_at > CHECKPOINT_SECONDS:
            _save(run, settings, env, learner, done)
            saved_at = time.monotonic()
    _save(run, settings, env, learner, done)
    return done.steps >= total


def _save(run: Path, settings: Settings, env: GaitEnv, learner: GaitPPO, done: _Clock) -> None:
    state = {
        "learner": learner.state(),
        "environment": env.state_dict(),
        "random": torch.get_rng_state(),
        "steps": done.steps,
        "seconds": done.seconds,
    }
    save_checkpoint(run, state)
    _save_policy(run, settings, env, learner, _provenance(settings, env, learner, done))


def _save_policy(
    run: Path, settings: Settings, env: GaitEnv, learner: GaitPPO, provenance: dict[str, Any]
) -> None:
    trace = golden_trace(learner.actor, env.table, env.robot, settings.world)
    save_policy(run, learner.actor, env, trace, provenance)


def _restore(saved: dict[str, Any], env: GaitEnv, learner: GaitPPO) -> _Clock:
    learner.restore(saved["learner"])
    env.load_state_dict(saved["environment"])
    torch.set_rng_state(saved["random"])
    return _Clock(saved["steps"], saved["seconds"])


def _provenance(
    settings: Settings, env: GaitEnv, learner: GaitPPO, done: _Clock
) -> dict[str, Any]:
    return {
        "trained_by": f"rmll {version('rmll')}",
        "commit": _commit(),
        "seed": settings.seed,
        "steps": done.steps,
        "minutes": round(done.seconds / 60, 2),
        "failed_simulations": env.simulation.failures,
        "rejected_updates": learner.rejected_updates,
        "torch": version("torch"),
        "mujoco": version("mujoco"),
        "settings": msgspec.to_builtins(settings),
    }


def _commit() -> str:
    """Commit of the source tree, with "+" if it was changed since; "unknown" outside git."""
    here = Path(__file__).parent
    try:
        call = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--dirty=+",
                "--exclude=*"]  # fmt: skip
        return subprocess.run(call, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


class _Interrupt:
    """Ctrl-C and SIGTERM ask for a clean stop after the current update."""

    def __enter__(self) -> "_Interrupt":
        self.asked = False
        self._before = {s: signal.signal(s, self._ask) for s in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, *_: object) -> None:
        self.asked = True
