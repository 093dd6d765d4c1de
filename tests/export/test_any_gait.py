"""Whatever gait the language can say, and whatever the trainer makes of it, the robot can prove."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from rmll_common.errors import Failure, InputError
from rmll_export.checkpoint_reader import read
from rmll_export.export_bundle import export
from rmll_gaits import pose
from rmll_gaits.compile import compile_gait
from rmll_gaits.label import NUM_LABELS
from rmll_gaits.spec import read_spec
from rmll_gaits.table import MachineTable
from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.emulator import EmulatorSettings as EmulatorSettings
from rmll_hil.runs import lockstep
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.control.controller import prove
from rmll_onboard.state.reports import RunReport
from rmll_train.train_settings import EnvSettings, LearnerSettings, TrainSettings
from rmll_train.training import Run

TINY = TrainSettings(
    world=EnvSettings(envs=8),
    learner=LearnerSettings(rollout=4, mini_batches=1, epochs=1, hidden=(16,),
                            estimator_hidden=(8,), estimator_batches=1, bf16=False),
)  # fmt: skip


@st.composite
def ranges(draw: st.DrawFn, least: float, most: float) -> list[float]:
    ends = st.floats(least, most, allow_nan=False).map(lambda value: round(value, 3))
    low, high = sorted((draw(ends), draw(ends)))
    return [low, draw(st.sampled_from((low, high)))]


@st.composite
def states(draw: st.DrawFn) -> dict[str, Any]:
    """One to five states; each sorts some contacts into edges that lead on, or to the sink."""
    names = [f"q{index}" for index in range(draw(st.integers(1, 5)))]
    found = {}
    for name in names:
        labels = draw(st.permutations(range(NUM_LABELS)))
        edges, used = [], 0
        for kind in ["on", *draw(st.lists(st.sampled_from(("on", "reject")), max_size=2))]:
            count = draw(st.integers(1, 4))
            guard = " | ".join(f"({pose.to_guard(label)})" for label in labels[used : used + count])
            used += count
            if kind == "on":
                dwell = draw(st.sampled_from((0.0, 0.5, 1.0, 1.37)))
                edges.append({"when": guard, "to": draw(st.sampled_from(names)), "dwell": dwell})
            else:
                edges.append({"when": guard, "reject": True, "grace": draw(st.integers(0, 20))})
        found[name] = edges
    return found


@st.composite
def gaits(draw: st.DrawFn) -> MachineTable:
    text = yaml.safe_dump({
        "gait": "any",
        "commands": {
            "vx": draw(ranges(-2, 2)), "wz": draw(ranges(-2, 2)), "frequency": draw(ranges(1, 20)),
        },
        "states": draw(states()),
    }, sort_keys=False)  # fmt: skip
    try:
        return compile_gait(read_spec(text, "any.yaml"))
    except InputError:
        assume(False)  # a state that cannot be reached
        raise


def trained(table: MachineTable, loudness: float, on_violation: str, folder: Path) -> Path:
    """A policy after one update, its last layers ``loudness`` times as large."""
    world = replace(TINY.world, on_violation=on_violation)
    run = Run(replace(TINY, world=world), table)
    run.update()
    with torch.no_grad():
        # an estimator learns by regression: it may be wrong by a factor, not by thousands
        for network, factor in ((run.policy.mlp, loudness), (run.policy.estimator, 10.0)):
            last = [layer for layer in network.modules() if isinstance(layer, torch.nn.Linear)][-1]
            last.weight.mul_(factor)
    folder.mkdir(exist_ok=True)
    run.save(folder)
    return folder / "policy.safetensors"


def walked(bundle: Bundle) -> RunReport:
    """What the daemon reports of a second's walk at the end of the gait's commands."""
    commands = bundle.table.commands
    operator = FlagOperator(commands, commands.vx[1], commands.wz[0], None, 1.0)
    emulator = Emulator(EmulatorSettings(), robot=bundle.robot, plan=[])
    return lockstep.walk(emulator, bundle, operator, lambda _: None).report


# a smaller gait would tell no more, and takes minutes to be found
@settings(
    max_examples=12,
    suppress_health_check=list(HealthCheck),
    phases=tuple(set(Phase) - {Phase.shrink, Phase.explain}),
)
@given(
    table=gaits(),
    loudness=st.sampled_from((1.0, 30.0, 1e3)),
    on_violation=st.sampled_from(("unpaid", "end")),
)
def test_every_gait_is_trained_exported_proven_and_walked(
    table: MachineTable, loudness: float, on_violation: str
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bundle = folder / "any.onnx"
        export(read(trained(table, loudness, on_violation, folder)), bundle)
        loaded = load_bundle(bundle)
        assert prove(loaded) >= 1
        report = walked(loaded)
    # an untrained robot may fall, and a wild one is stopped: what counts is that it is said
    assert report.fault is None or isinstance(report.fault, str)


def test_an_action_beyond_its_range_is_compared_as_the_network_gave_it(tmp_path: Path) -> None:
    table = compile_gait(read_spec(LIMP, "limp.yaml"))
    bundle = tmp_path / "limp.onnx"
    export(read(trained(table, 1e3, "unpaid", tmp_path)), bundle)
    loaded = load_bundle(bundle)
    actions = torch.tensor(loaded.contract.trace.action)
    assert actions.abs().max() > 2 * loaded.contract.action_clip
    assert prove(loaded) == len(actions)


LIMP = """
gait: limp
commands: {vx: [0.2, 0.9], wz: [-1, -0.5], frequency: [6.25, 6.5]}
cycle: [FL BL BR, FL FR BL]
"""


def test_a_bundle_that_the_daemon_would_refuse_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For what reason soever: here, that its trainer and its daemon clip actions differently."""
    table = compile_gait(read_spec(LIMP, "limp.yaml"))
    checkpoint = read(trained(table, 1e3, "unpaid", tmp_path / "run"))
    monkeypatch.setattr("rmll_onboard.control.controller.TRACE_TOLERANCE", -1.0)
    (tmp_path / "out").mkdir()
    with pytest.raises(Failure, match=r"the daemon would refuse it: limp\.onnx: the golden trace"):
        export(checkpoint, tmp_path / "out" / "limp.onnx")
    assert list((tmp_path / "out").iterdir()) == []
