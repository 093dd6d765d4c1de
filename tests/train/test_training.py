"""Short real runs: what they leave behind, how they stop, and that they go on where they were."""

import copy
import os
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from rmll_common.errors import Failure, InputError
from rmll_export.checkpoint_reader import read
from rmll_export.export_bundle import export
from rmll_gaits.load import load_gait
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import prove
from rmll_robots import A1
from rmll_train.checkpoint import load_checkpoint, save_checkpoint
from rmll_train.cli import _chosen, _continued, _summary, count, main
from rmll_train.env.environment import GaitEnv
from rmll_train.golden_trace import golden_trace
from rmll_train.learning.gait_ppo import GaitPPO
from rmll_train.learning.precision import Precision
from rmll_train.learning.return_scale import ReturnScale
from rmll_train.learning.samples import collected
from rmll_train.periodic_evaluation import WHERE, evaluate
from rmll_train.train_settings import EnvSettings, LearnerSettings, TrainSettings, to_yaml
from rmll_train.training import Judging, Run, Start, TrainingProgress, train

ENVS, ROLLOUT = 16, 8
SMALL = TrainSettings(
    world=EnvSettings(envs=ENVS),
    learner=LearnerSettings(steps=4 * ENVS * ROLLOUT, rollout=ROLLOUT, epochs=2, mini_batches=2,
                    hidden=(32, 32), estimator_hidden=(16,), bf16=False),
)  # fmt: skip


def quiet(_: object) -> None:
    pass


def steps(settings: TrainSettings, updates: int) -> TrainSettings:
    learner = replace(settings.learner, steps=updates * ENVS * ROLLOUT)
    return replace(settings, learner=learner)


def test_a_run_leaves_settings_checkpoint_policy_curves_and_result(tmp_path: Path) -> None:
    run, seen = tmp_path / "run", []
    assert train(run, SMALL, seen.append, resume=False)
    updates = [told for told in seen if isinstance(told, TrainingProgress)]
    assert [progress.steps for progress in updates] == [n * ENVS * ROLLOUT for n in (1, 2, 3, 4)]
    assert seen[0] == Start(Precision(bf16=False, gain=None), load_gait("trot").commands, 0,
                            SMALL.learner.steps)  # fmt: skip
    assert isinstance(seen[-1], Judging) and seen[-1].done == seen[-1].total
    names = {path.name.split(".")[0] for path in run.iterdir()}
    assert names == {"gait", "settings", "checkpoint", "policy", "events", "result"}
    assert len({path.stat().st_mode for path in run.iterdir()}) == 1
    result = yaml.safe_load((run / "result.yaml").read_text())
    assert result["steps"] == 4 * ENVS * ROLLOUT and result["seed"] == 0
    assert 0 <= result["metrics"]["off_spec_contact"] <= 1
    assert not result["useful"] and result["shortfalls"]  # after four updates


def test_a_policy_that_never_learned_the_gait_is_measured_by_all_of_its_rules() -> None:
    """A half_bound rejects standing on all feet; until the demands are strict it only waits."""
    env = GaitEnv(load_gait("half_bound"), A1, EnvSettings(envs=ENVS, on_violation="end"), seed=0)
    assert not env.demands.strict
    sums = evaluate(lambda _: torch.zeros(ENVS, 12), env, steps=50)
    assert sums.metrics()["early_ends"] == 1.0
    assert env.demands.clearance == env.world.clearance


@pytest.mark.parametrize("profile", ["paper", "imu"])
@pytest.mark.parametrize("gait", ["trot", "half_bound"])
def test_from_the_trainer_to_the_robots_controller_nothing_changes(
    tmp_path: Path, gait: str, profile: str
) -> None:
    """Torch in the trainer, onnxruntime and NumPy on the robot: labels, states, observations,
    estimates, actions and targets agree over a recorded episode."""
    chosen = replace(SMALL, gait=gait, world=replace(SMALL.world, profile=profile))
    run = tmp_path / "run"
    train(run, chosen, quiet, resume=False)
    bundle = tmp_path / "gait.onnx"
    assert export(read(run / "policy.safetensors"), bundle) < 1e-5
    prove(load_bundle(bundle))


def test_a_resumed_run_ends_where_an_unbroken_one_does(tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    train(whole, steps(SMALL, 4), quiet, resume=False)
    train(broken, steps(SMALL, 2), quiet, resume=False)
    train(broken, steps(SMALL, 4), quiet, resume=True)
    expected, found = load_checkpoint(whole), load_checkpoint(broken)
    assert found["steps"] == expected["steps"]
    for name, value in expected["learner"]["actor_state_dict"].items():
        assert torch.allclose(found["learner"]["actor_state_dict"][name], value, atol=1e-4), name


def test_a_run_that_goes_on_with_other_settings_tells_of_its_stages(tmp_path: Path) -> None:
    run = tmp_path / "run"
    first = steps(SMALL, 1)
    train(run, first, quiet, resume=False)
    train(run, steps(SMALL, 2), quiet, resume=True)
    assert provenance(run)["stages"] == []  # more steps alone are no new stage
    rewards = replace(first.world.rewards, velocity_yaw=2.0)
    other = replace(first, world=replace(first.world, rewards=rewards))
    train(run, steps(other, 3), quiet, resume=True)
    train(run, steps(other, 4), quiet, resume=True)
    found = provenance(run)
    weights = [stage["settings"]["world"]["rewards"]["velocity_yaw"] for stage in found["stages"]]
    assert weights == [first.world.rewards.velocity_yaw]
    assert found["settings"]["world"]["rewards"]["velocity_yaw"] == 2.0
    assert [stage["steps"] for stage in found["stages"]] == [2 * ENVS * ROLLOUT]
    assert found["steps"] == 4 * ENVS * ROLLOUT


def provenance(run: Path) -> dict[str, Any]:
    return read(run / "policy.safetensors").contract.provenance


def test_resuming_takes_changed_settings_from_a_file(tmp_path: Path) -> None:
    before = replace(SMALL, seed=3)
    (tmp_path / "settings.yaml").write_text(to_yaml(before))
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text("world: {episode: 5.0}")
    assert _continued(tmp_path, overlay) == replace(before, world=replace(SMALL.world, episode=5.0))
    overlay.write_text("seed: 4")
    with pytest.raises(InputError, match=r"overlay.yaml: a run cannot change its gait or seed"):
        _continued(tmp_path, overlay)


def test_a_restored_run_is_exactly_the_one_that_was_saved(tmp_path: Path) -> None:
    run, restored = (Run(SMALL, load_gait(SMALL.gait)) for _ in range(2))
    for _ in range(3):
        run.update()
    for name, of in (("first", run), ("second", restored)):
        (tmp_path / name).mkdir()
        of.save(tmp_path / name)
        restored.restore(load_checkpoint(tmp_path / "first"))
    first, second = (load_checkpoint(tmp_path / name) for name in ("first", "second"))
    exactly = {"rtol": 0.0, "atol": 0.0, "equal_nan": True}
    for part in ("environment", "random"):
        torch.testing.assert_close(second[part], first[part], **exactly)
    assert first["learner"].keys() == second["learner"].keys()
    for part, state in first["learner"].items():
        torch.testing.assert_close(second["learner"][part], state, **exactly, msg=part)


def test_a_run_that_was_killed_goes_on_without_a_jump_in_its_curves(tmp_path: Path) -> None:
    """kill -9 in the middle, resumed: curves and networks are those of an unbroken run."""
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    train(whole, steps(SMALL, 60), quiet, resume=False)
    code = (
        "import sys, pathlib; from rmll_train import training, train_settings as settings\n"
        "training.CHECKPOINT_SECONDS = 0.0\n"
        "chosen = settings.load(pathlib.Path(sys.argv[1]), settings.TrainSettings())\n"
        "def report(told): print(told, flush=True)\n"
        "training.train(pathlib.Path(sys.argv[2]), chosen, report, resume=False)"
    )
    call = [sys.executable, "-c", code, str(whole / "settings.yaml"), str(killed)]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for _ in range(8):  # how matrices are multiplied, and seven updates
        process.stdout.readline()
    process.kill()
    process.communicate(timeout=240)
    reached = load_checkpoint(killed)["steps"] // (ENVS * ROLLOUT)
    assert 6 <= reached < 60

    train(killed, steps(SMALL, 60), quiet, resume=True)
    expected, found = curves(whole), curves(killed)
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        assert found[name] == pytest.approx(values, rel=1e-3, abs=1e-3), name


def curves(run: Path) -> dict[str, list[float]]:
    accumulator = EventAccumulator(str(run), size_guidance={"scalars": 0})
    accumulator.Reload()
    return {
        name: [event.value for event in accumulator.Scalars(name)]
        for name in accumulator.Tags()["scalars"]
    }


def test_a_checkpoint_of_another_version_is_refused_in_one_line(tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(run, steps(SMALL, 1), quiet, resume=False)
    saved = load_checkpoint(run)
    del saved["environment"]["buffers"]["threshold"]
    save_checkpoint(run, saved)
    with pytest.raises(InputError, match=r"another version of rmll-train.*threshold"):
        train(run, steps(SMALL, 2), quiet, resume=True)


def test_a_run_whose_gait_has_changed_is_not_gone_on_with(tmp_path: Path) -> None:
    gait, run = tmp_path / "hop.yaml", tmp_path / "run"
    gait.write_text(HOP)
    begun = replace(steps(SMALL, 1), gait=str(gait))
    train(run, begun, quiet, resume=False)
    gait.write_text("# a remark\n" + HOP)
    train(run, steps(begun, 2), quiet, resume=True)

    gait.write_text(HOP.replace("[6, 12]", "[6, 10]"))
    with pytest.raises(
        InputError, match=r"hop.yaml has changed .*frequency: \[6, 12\], now \[6, 10\]"
    ):
        train(run, steps(begun, 3), quiet, resume=True)
    assert load_checkpoint(run)["steps"] == 2 * ENVS * ROLLOUT

    gait.unlink()  # the run has its own copy
    train(run, steps(begun, 3), quiet, resume=True)
    assert load_checkpoint(run)["steps"] == 3 * ENVS * ROLLOUT


def test_the_copy_that_a_run_keeps_of_its_gait_is_what_it_learns(tmp_path: Path) -> None:
    gait, run = tmp_path / "hop.yaml", tmp_path / "run"
    gait.write_text(HOP)
    begun = replace(steps(SMALL, 1), gait=str(gait))

    def edit(told: object) -> None:
        if isinstance(told, Start):
            gait.write_text(HOP.replace("[6, 12]", "[6, 10]"))

    train(run, begun, edit, resume=False)
    assert (run / "gait.yaml").read_text() == HOP

    gait.unlink()
    (run / "gait.yaml").write_text(HOP.replace("[6, 12]", "[6, 10]"))
    with pytest.raises(InputError, match=r"run/gait\.yaml has changed since the run began"):
        train(run, steps(begun, 2), quiet, resume=True)


def test_a_run_that_goes_on_is_not_finished(tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(run, steps(SMALL, 1), quiet, resume=False)

    def stop(told: object) -> None:
        if isinstance(told, TrainingProgress):
            signal.raise_signal(signal.SIGINT)

    assert not train(run, steps(SMALL, 9), stop, resume=True)
    assert not (run / "result.yaml").exists()


@pytest.mark.parametrize("flags", [["--envs", "0"], ["--seed", "0"], ["--runs", "other"], ["trot"]])
def test_a_resumed_run_takes_nothing_that_it_would_not_heed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], flags: list[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["rmll-train", "--resume", "run", *flags])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert "--resume takes the run's own settings" in capsys.readouterr().err


def test_a_command_to_go_on_with_can_be_pasted() -> None:
    result: dict[str, Any] = {
        "metrics": {"adherence": 0.1, "vx_error": 0.1, "wz_error": 0.1, "falls": 0.0,
                    "off_spec_contact": 0.1},
        "measured": "here", "limits": [], "useful": False, "shortfalls": [], "steps": 5,
    }  # fmt: skip
    run = Path("my runs/it's")
    told = [shlex.split(line) for line in _summary(run, result) if "--resume" in line]
    assert told == [["rmll-train", "--resume", str(run), "--steps", "10"]]
    (export,) = (line for line in _summary(run, result | {"useful": True}) if "export" in line)
    assert shlex.split(export)[-2:] == ["rmll-export", str(run)]


HOP = """
gait: hop
commands: {vx: [-1, 1], wz: [-1, 1], frequency: [6, 12]}
cycle: [FL BR, FR BL]
"""


def test_a_policy_tells_its_gait_and_not_where_the_file_lay(tmp_path: Path) -> None:
    gait, run = tmp_path / "mine.yaml", tmp_path / "run"
    gait.write_text(HOP)
    train(run, replace(steps(SMALL, 1), gait=str(gait)), quiet, resume=False)
    assert provenance(run)["settings"]["gait"] == "hop"
    for name in ("policy.safetensors", "result.yaml"):
        assert str(tmp_path).encode() not in (run / name).read_bytes()


def test_a_run_can_be_resumed_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / "hop.yaml").write_text(HOP)
    monkeypatch.chdir(tmp_path / "here")
    begun = _chosen("hop.yaml", "default", None, ENVS, None)
    train(Path("run"), replace(begun, learner=SMALL.learner), quiet, resume=False)
    monkeypatch.chdir(tmp_path)
    assert _continued(Path("here/run"), None).gait == str(tmp_path / "here" / "hop.yaml")
    train(Path("here/run"), _continued(Path("here/run"), None), quiet, resume=True)


@pytest.mark.parametrize(
    ("text", "number"),
    [("3000000", 3_000_000), ("3e6", 3_000_000), ("3M", 3_000_000), ("1.5M", 1_500_000),
     ("200k", 200_000), ("3_000_000", 3_000_000), ("1E3", 1000)],
)  # fmt: skip
def test_a_number_of_steps_may_be_written_as_people_do(text: str, number: int) -> None:
    assert count("steps", text) == number


@pytest.mark.parametrize(
    "text", ["", "M", "-3", "1.5", "1e-3", "1e99", "nan", "inf", "3 M", "0x10", "3MM", "٣k"]
)
def test_what_is_no_whole_number_is_none(text: str) -> None:
    with pytest.raises(InputError, match=f"--steps {text}: expected a whole number"):
        count("steps", text)


def test_one_seed_gives_one_policy(tmp_path: Path) -> None:
    states = []
    for name in ("first", "second"):
        train(tmp_path / name, steps(SMALL, 2), quiet, resume=False)
        states.append(load_checkpoint(tmp_path / name)["learner"]["actor_state_dict"])
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


def test_ctrl_c_ends_after_the_update_with_a_checkpoint(tmp_path: Path) -> None:
    call = [sys.executable, "-m", "rmll_train.cli", "--gait", "trot", "--envs", "16",
            "--runs", str(tmp_path)]  # fmt: skip
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 240
    while not list(tmp_path.glob("trot/*/events*")) and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(1.0)
    os.kill(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=240)
    assert process.returncode == 130, err
    (run,) = tmp_path.glob("trot/*")
    assert f"--resume {run}" in out
    assert load_checkpoint(run)["steps"] > 0
    assert not (run / "result.yaml").exists()


def test_a_file_that_is_no_checkpoint_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such checkpoint"):
        load_checkpoint(tmp_path)
    (tmp_path / "checkpoint.pt").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match=r"checkpoint\.pt: not a checkpoint"):
        load_checkpoint(tmp_path)


@pytest.mark.parametrize("name", ["steps", "provenance", "whole", "cut"])
def test_a_checkpoint_of_another_hand_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    run = tmp_path / "run"
    train(run, steps(SMALL, 1), quiet, resume=False)
    saved: Any = load_checkpoint(run)
    if name == "cut":
        path = run / "checkpoint.pt"
        path.write_bytes(path.read_bytes()[:5000])
    else:
        save_checkpoint(run, [saved] if name == "whole" else saved | {name: "x"})
    with pytest.raises(InputError, match=r"checkpoint\.pt: not a checkpoint of rmll-train"):
        train(run, steps(SMALL, 2), quiet, resume=True)


def test_a_checkpoint_with_a_strange_part_is_of_another_version(tmp_path: Path) -> None:
    run = tmp_path / "run"
    train(run, steps(SMALL, 1), quiet, resume=False)
    saved = load_checkpoint(run)
    save_checkpoint(run, saved | {"learner": dict.fromkeys(saved["learner"], 5)})
    with pytest.raises(InputError, match="its checkpoint is of another version"):
        train(run, steps(SMALL, 2), quiet, resume=True)


def learner() -> GaitPPO:
    torch.manual_seed(0)
    return GaitPPO(GaitEnv(load_gait("trot"), A1, SMALL.world, 0), SMALL.learner)


def roll_out(ppo: GaitPPO, env: GaitEnv, poison: bool) -> None:
    obs = env.get_observations()
    with torch.inference_mode():
        for _ in range(ROLLOUT):
            obs, rewards, dones, extras = env.step(ppo.act(obs))
            ppo.process_env_step(obs, rewards * (torch.nan if poison else 1.0), dones, extras)
        ppo.compute_returns(obs)


def test_gradients_that_are_not_finite_are_skipped_counted_and_in_the_end_stop_the_run() -> None:
    ppo = learner()
    ppo.return_scale = None
    epochs = SMALL.learner.epochs + SMALL.learner.critic_epochs
    all_of_actor_and_critic = epochs * SMALL.learner.mini_batches
    env = GaitEnv(load_gait("trot"), A1, SMALL.world, 0)
    before = {name: value.clone() for name, value in ppo.critic.state_dict().items()}
    roll_out(ppo, env, poison=True)
    ppo.update()
    assert ppo.skipped_steps == all_of_actor_and_critic
    assert all(torch.equal(before[name], value) for name, value in ppo.critic.state_dict().items())
    roll_out(ppo, env, poison=False)
    ppo.update()
    assert ppo.skipped_steps == all_of_actor_and_critic
    with pytest.raises(Failure, match="diverged"):
        for _ in range(10):
            roll_out(ppo, env, poison=True)
            ppo.update()


def test_policy_and_estimator_learn_each_from_its_own_loss_alone() -> None:
    learned = []
    for left_over in (None, 1e6):
        ppo = learner()
        ppo.estimator_optimizer.param_groups[0]["lr"] = 0.0
        before = [p.clone() for p in ppo.policy.estimator.parameters()]
        roll_out(ppo, GaitEnv(load_gait("trot"), A1, SMALL.world, 0), poison=False)
        for parameter in ppo.policy.estimator.parameters():
            parameter.grad = left_over and torch.full_like(parameter, left_over)
        ppo.update()
        after = list(ppo.policy.estimator.parameters())
        assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))
        learned.append(ppo.policy.mlp.state_dict())
    # the estimator's gradients, of whatever size, do not count when PPO clips the actor's
    assert all(torch.equal(learned[0][name], value) for name, value in learned[1].items())


def test_the_critic_learns_at_the_rates_that_the_actor_had_an_update_before() -> None:
    ppo, env = learner(), GaitEnv(load_gait("trot"), A1, SMALL.world, 0)
    acting, judging = [], []
    for optimizer, rates in ((ppo.optimizer, acting), (ppo.critic_optimizer, judging)):
        optimizer.register_step_pre_hook(
            lambda at, *_, rates=rates: rates.append(at.param_groups[0]["lr"])
        )
    for _ in range(3):
        roll_out(ppo, env, poison=False)
        ppo.update()
    steps, judged = (
        epochs * SMALL.learner.mini_batches
        for epochs in (SMALL.learner.epochs, SMALL.learner.critic_epochs)
    )
    first = [SMALL.learner.learning_rate] * judged
    assert judging == first + acting[:judged] + acting[steps : steps + judged]
    assert len(set(acting)) > 1


def test_a_batch_shared_out_between_threads_is_the_same_step() -> None:
    env = GaitEnv(load_gait("trot"), A1, SMALL.world, 0)
    ppo = learner()
    roll_out(ppo, env, poison=False)
    order = torch.randperm(ppo.storage.rewards.numel())
    batch = collected(ppo.storage, order)
    start = copy.deepcopy((ppo.policy.state_dict(), ppo.optimizer.state_dict()))
    results = []
    for parts in ([batch], batch.batches(2), batch.batches(2)):
        ppo.policy.load_state_dict(start[0])
        ppo.optimizer.load_state_dict(copy.deepcopy(start[1]))
        ppo.learning_rate = SMALL.learner.learning_rate
        done = ppo._improve([parts])
        gradient = torch.cat([p.grad.flatten() for p in ppo.policy.mlp.parameters()])
        results.append((torch.tensor(done.losses), gradient.clone()))
    (losses, whole), (shared_losses, shared), (_, again) = results
    torch.testing.assert_close(shared_losses, losses)
    torch.testing.assert_close(shared, whole, rtol=0.02, atol=0.02 * float(whole.abs().max()))
    assert torch.equal(shared, again)  # whichever thread adds its half first


def test_returns_scaled_have_unit_spread() -> None:
    torch.manual_seed(0)
    scale = ReturnScale(envs=64, gamma=0.9)
    never = torch.zeros(64, dtype=torch.bool)
    for _ in range(2000):
        scaled = scale(torch.full((64,), 30.0), never)
    assert scaled.mean() == pytest.approx(0.1, rel=0.05)  # 30 a step is a return of 300


def test_the_golden_trace_is_one_episode_from_its_start() -> None:
    trace = golden_trace(learner().policy, load_gait("trot"), A1, SMALL.world)
    assert trace.state[0] == 0 and trace.phi[0] == 0 and trace.label[0] == 15
    assert len({len(getattr(trace, name)) for name in trace.__struct_fields__}) == 1


def test_a_finished_run_is_told_in_80_columns() -> None:
    metrics = {"adherence": 0.915, "vx_error": 0.148, "wz_error": 0.399, "falls": 212.0,
               "off_spec_contact": 0.35}  # fmt: skip
    limits = ["a joint was past its limit by 0.0797 rad, limit 0.05, in 12 of 64 walks"]
    result = {"metrics": metrics, "measured": WHERE, "limits": limits, "useful": False,
              "shortfalls": ["falls: 212, none wanted"], "steps": 15_015_936}  # fmt: skip
    folder = Path("runs/rotary_gallop/20261201-092532-seed0")
    for told in (_summary(folder, result), _summary(folder, result | {"useful": True})):
        assert max(map(len, told)) <= 80
        assert f"  {limits[0]}" in told
    assert "not useful yet:" in _summary(folder, result)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_while_the_policy_is_judged_is_clean_too(number: int, tmp_path: Path) -> None:
    run = tmp_path / "run"

    def stopping(told: object) -> None:
        if isinstance(told, Judging) and told.done == 5:
            os.kill(os.getpid(), number)

    assert not train(run, steps(SMALL, 1), stopping, resume=False)
    assert not (run / "result.yaml").exists()
    assert train(run, steps(SMALL, 1), quiet, resume=True)
    assert (run / "result.yaml").exists()
