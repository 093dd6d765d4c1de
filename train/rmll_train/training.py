"""One training run: from settings to a folder with checkpoints, curves and a policy."""

import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import yaml
from torch.utils.tensorboard import SummaryWriter

from rmll_common.errors import InputError
from rmll_gaits.changes import changes
from rmll_gaits.compile import compile_gait
from rmll_gaits.load import load_gait, load_text
from rmll_gaits.spec import read_spec
from rmll_gaits.table import Commands, MachineTable
from rmll_robots import A1
from rmll_train import train_settings as settings_file
from rmll_train.checkpoint import (
    CheckpointState,
    load_checkpoint,
    save_checkpoint,
    save_policy,
)
from rmll_train.env.environment import GaitEnv
from rmll_train.golden_trace import golden_trace
from rmll_train.learning import precision
from rmll_train.learning.actor_critic import EstimatingActor
from rmll_train.learning.gait_ppo import GaitPPO
from rmll_train.learning.precision import Precision
from rmll_train.periodic_evaluation import WHERE, Judge
from rmll_train.provenance import Provenance, Stage, origin, stages
from rmll_train.train_settings import TrainSettings

SETTINGS = "settings.yaml"
GAIT = "gait.yaml"
"""The run's own copy of its gait's file"""
RESULT = "result.yaml"
"""Written last: a run that has it is finished"""
CHECKPOINT_SECONDS = 45.0
JUDGE_SEED = 1000
"""Added to the run's seed: a policy is not judged in the very world it was trained in"""


@dataclass(frozen=True)
class TrainingProgress:
    """What a reporter is shown after every update."""

    steps: int
    total: int
    rate: float
    """environment steps a second, learning included, over this update"""
    metrics: dict[str, float]
    losses: dict[str, float]


@dataclass(frozen=True)
class Judging:
    """What a reporter is shown while the trained policy walks without exploration."""

    done: int
    total: int
    """policy steps"""


@dataclass(frozen=True)
class Start:
    """What a reporter is shown first."""

    precision: Precision
    commands: Commands
    """The gait's ranges"""
    steps: int
    """Taken already, by a run that goes on"""
    total: int


Report = Callable[[Start | TrainingProgress | Judging], None]


def train(folder: Path, settings: TrainSettings, report: Report, resume: bool) -> bool:
    """Train until ``settings.learner.steps``; returns False if Ctrl-C or SIGTERM ended it before.

    ``folder`` then holds the gait and the settings, ``checkpoint.pt`` (at most a minute old at any
    time), ``policy.safetensors``, TensorBoard events and, when finished, ``result.yaml``.
    Raises Failure when training diverges, the last good checkpoint stays; InputError if a resumed
    run's gait has changed.
    """
    # read once: who edits the file from here on does not edit this run
    text, source = load_text(_copy(folder) if resume else settings.gait)
    gait = compile_gait(read_spec(text, source))
    saved = load_checkpoint(folder) if resume else None
    if saved is not None:
        _check_unchanged(gait, settings.gait, folder, saved)
    run = Run(settings, gait)
    if saved is not None:
        try:
            run.restore(saved)
        except (KeyError, RuntimeError, TypeError, ValueError) as error:
            raise InputError(
                f"{folder}: its checkpoint is of another version of rmll-train or of other "
                f"settings: {error}; go on with the version that began it"
            ) from error
    total = settings.learner.steps
    report(Start(run.precision, gait.commands, run.steps, total))
    folder.mkdir(parents=True, exist_ok=resume)
    (folder / SETTINGS).write_text(settings_file.to_yaml(settings))
    if not resume:
        (folder / GAIT).write_text(text, "utf-8")
    if run.steps < total:
        (folder / RESULT).unlink(missing_ok=True)  # it is that of the policy before
    with _Interrupt() as interrupt, SummaryWriter(str(folder), purge_step=run.steps + 1) as writer:
        saved_at = time.monotonic()
        while run.steps < total and not interrupt.asked:
            progress = run.update()
            _draw(writer, progress)
            report(progress)
            if time.monotonic() - saved_at > CHECKPOINT_SECONDS:
                writer.flush()  # first the curves: a resumed run draws only from its checkpoint on
                run.save(folder)
                saved_at = time.monotonic()
        run.save(folder)
        if not interrupt.asked:
            with suppress(_Stopped):
                run.finish(folder, interrupt.heeded_by(report))
                return True
    return False


def _copy(folder: Path) -> Path:
    """The run's own copy of its gait's file; InputError if it has none."""
    if not (copy := folder / GAIT).is_file():
        raise InputError(f"{copy}: no such file; a run of this version of rmll-train has one")
    return copy


def _check_unchanged(begun: MachineTable, gait: str, folder: Path, saved: CheckpointState) -> None:
    """Raises InputError unless ``begun``, the run's copy, is the gait of its checkpoint, and
    ``gait``, the file it was copied from, says the same or is gone."""
    copy = folder / GAIT
    if saved.get("rules", begun.rules) != begun.rules:  # older checkpoints do not tell them
        raise InputError(
            f"{copy} has changed since the run began: what was learnt holds for the old rules. "
            f"Begin a new run, or put back what the file said"
        )
    if Path(gait).suffix and not Path(gait).is_file():
        return
    if found := list(changes(begun, load_gait(gait))):
        raise InputError(
            f"{gait} has changed since the run began ({'; '.join(found)}): what was learnt holds "
            f"for the old rules. Begin a new run, or put back {copy}"
        )


def _draw(writer: SummaryWriter, progress: TrainingProgress) -> None:
    for group, values in (("walk", progress.metrics), ("loss", progress.losses)):
        for name, value in values.items():
            writer.add_scalar(f"{group}/{name}", value, progress.steps)


class Run:
    """The parts of a run that change while it trains."""

    def __init__(self, settings: TrainSettings, gait: MachineTable):
        self.precision = precision.choose(settings)
        learner = replace(settings.learner, bf16=self.precision.bf16)
        self._settings = settings = replace(settings, learner=learner)
        torch.manual_seed(settings.seed)
        self._origin = origin(settings, gait)
        self._stages: list[Stage] = []
        """Earlier ones of a run that goes on with other code or settings"""
        self._env = GaitEnv(gait, A1, settings.world, settings.seed)
        self._learner = GaitPPO(self._env, settings.learner)
        self.steps = 0
        self.seconds = 0.0
        """of training, all sessions of the run together"""

    @property
    def policy(self) -> EstimatingActor:
        return self._learner.policy

    def update(self) -> TrainingProgress:
        """Collect one rollout and learn from it."""
        began = time.monotonic()
        env, learner, rollout = self._env, self._learner, self._settings.learner.rollout
        learner.entropy_coef = self._settings.learner.entropy[env.demands.strict]
        losses = learner.learn(env)
        taken = env.num_envs * rollout
        elapsed = time.monotonic() - began
        self.steps += taken
        self.seconds += elapsed

        walked = env.take_metrics().metrics()
        env.demands.update(walked["adherence"], walked["vx_error"], rollout)
        metrics = walked | {
            "cost_scale": env.demands.cost_scale,
            "strict": float(env.demands.strict),
            "action_std": float(learner.policy.output_std.detach().mean()),
            "learning_rate": learner.learning_rate,
            "failures": float(env.failures),
            "skipped_steps": float(learner.skipped_steps),
        }
        total = self._settings.learner.steps
        return TrainingProgress(self.steps, total, taken / elapsed, metrics, losses)

    def save(self, folder: Path) -> None:
        """Write both checkpoint files."""
        state: CheckpointState = {
            "learner": self._learner.state(),
            "environment": self._env.state_dict(),
            "rules": self._env.table.rules,
            "random": torch.get_rng_state(),
            "steps": self.steps,
            "seconds": self.seconds,
            "provenance": self._provenance(),
        }
        save_checkpoint(folder, state)
        self._save_policy(folder, state["provenance"])

    def restore(self, saved: CheckpointState) -> None:
        """Go on from what :meth:`save` wrote."""
        self._stages = stages(saved["provenance"], self._origin)
        self._learner.restore(saved["learner"])
        self._env.load_state_dict(saved["environment"])
        torch.set_rng_state(saved["random"])
        self.steps, self.seconds = saved["steps"], saved["seconds"]

    def judge(self) -> Judge:
        """The world in which this run's policies are judged."""
        env, settings = self._env, self._settings
        return Judge(env.table, env.robot, settings.world, settings.seed + JUDGE_SEED)

    def finish(self, folder: Path, report: Report) -> None:
        """Judge the policy and write the result."""
        judge = self.judge()
        judgement = judge(self.policy, lambda done: report(Judging(done, judge.steps)))
        result: Provenance = {
            **self._provenance(),
            "metrics": judgement.metrics,
            "measured": WHERE,
            "useful": judgement.useful,
            "shortfalls": judgement.shortfalls,
            "limits": judgement.limits,
        }
        self._save_policy(folder, result)
        (folder / RESULT).write_text(yaml.safe_dump(result, sort_keys=False))

    def _save_policy(self, folder: Path, provenance: Provenance) -> None:
        env, policy = self._env, self._learner.policy
        trace = golden_trace(policy, env.table, env.robot, self._settings.world)
        save_policy(folder, policy, env, trace, provenance)

    def _provenance(self) -> Provenance:
        return {
            **self._origin,
            "steps": self.steps,
            "minutes": round(self.seconds / 60, 2),
            "failed_simulations": self._env.failures,
            "skipped_steps": self._learner.skipped_steps,
            "stages": self._stages,
        }


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

    def heeded_by(self, report: Report) -> Report:
        """``report`` that raises _Stopped once a stop was asked for: a judgement is not saved."""

        def heeding(told: Start | TrainingProgress | Judging) -> None:
            if self.asked:
                raise _Stopped
            report(told)

        return heeding


class _Stopped(Exception):
    """The judgement was broken off."""
