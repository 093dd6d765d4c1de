"""The emulated robot on ground that is not flat."""

import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import get_args

import mujoco
import numpy as np
import pytest
import torch

from rmll_common.errors import InputError
from rmll_hil.robot.emulator import TRUTH_MS, Emulator, EmulatorSettings
from rmll_hil.robot.world import push
from rmll_hil.runs import lockstep
from rmll_hil.runs.metrics import summary
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.protocol.a1_packets import encode_command
from rmll_onboard.state.robot_state import MotorCommand
from rmll_robots import A1
from rmll_robots.ground import HeightField, Kind, course, lay
from rmll_train.env import terrain
from rmll_train.env.simulation import PHYSICS_STEP

KINDS = get_args(Kind)
TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"


def emulator(ground: Kind, level: int = 2, seed: int = 0) -> Emulator:
    return Emulator(EmulatorSettings(seed=seed, ground=ground, level=level))


def height(robot: Emulator, x: float, y: float) -> float:
    """The emulator's ground below a point, as MuJoCo has it."""
    model, data = robot.world.model, robot.world.data
    floor = model.geom("floor").id
    above, down = np.array([x, y, 20.0]), np.array([0.0, 0.0, -1.0])
    return 20.0 - mujoco.mj_rayHfield(model, data, floor, above, down)


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_the_trainers_ground(kind: Kind) -> None:
    robot = emulator(kind, level=7, seed=3)
    trained = terrain.build(course(kind, 7), seed=3)
    points = np.random.default_rng(0).uniform(-26, 26, (300, 2))
    theirs = trained.height(*torch.from_numpy(points.T.astype(np.float32)))
    ours = np.array([height(robot, x, y) for x, y in points])
    np.testing.assert_allclose(ours, theirs.numpy(), atol=2e-3)
    assert ours.std() > 0.01


@pytest.mark.parametrize("kind", KINDS)
def test_the_robot_lies_on_a_flat_place_in_the_middle(kind: Kind) -> None:
    robot = emulator(kind, level=9)
    around = [height(robot, x, y) for x in (-0.4, 0, 0.4) for y in (-0.4, 0, 0.4)]
    assert np.ptp(around) < 1e-3
    robot.advance(TRUTH_MS, 0)
    lying = robot.truth()["position"][0] - [0, 0, around[0]]
    np.testing.assert_allclose(lying, Emulator().world.data.qpos[:3], atol=5e-3)


def test_a_robot_that_lands_on_its_back_touches_the_terrain_with_its_base() -> None:
    robot = emulator("downhill", level=9)
    # off the top: some metres down the slope, and still far above the world's zero
    robot.world.data.qpos[:3] = [4.0, 0.0, height(robot, 4.0, 0.0) + 0.2]
    robot.world.data.qpos[3:7] = [0, 1, 0, 0]
    robot.advance(1000, 0)  # it bounces once
    truth = robot.truth()
    assert truth["position"][:, 2].min() > 2
    assert not truth["grounded"][0]
    assert truth["grounded"][-50:].all()


@pytest.mark.parametrize("timestep", [0.001, PHYSICS_STEP])
def test_a_foot_that_lands_hard_is_not_caught_inside_the_ground(timestep: float) -> None:
    """The sides of a height field's prisms must not hold what sank in between them."""
    random = np.random.default_rng(0)
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    foot = spec.worldbody.add_body()
    foot.add_freejoint()
    foot.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[A1.foot_radius, 0, 0], mass=3.0)
    lay(spec, HeightField(np.zeros((40, 40), np.float32), np.zeros((1, 1, 2), np.float32)))
    model = spec.compile()
    for _ in range(100):
        data = mujoco.MjData(model)
        data.qpos[:3] = *random.uniform(-1, 1, 2), A1.foot_radius
        data.qvel[:3] = *random.uniform(-0.5, 0.5, 2), -2.0
        for _ in range(round(0.1 / timestep)):
            mujoco.mj_step(model, data)
            assert (np.abs(data.contact.frame[:, 2]) > 0.3).all()


def test_the_trot_walks_on_rough_ground() -> None:
    robot, bundle = emulator("rough"), load_bundle(TROT)
    operator = FlagOperator(bundle.table.commands, vx=0.5, seconds=4.0)
    outcome = lockstep.walk(robot, bundle, operator, lambda _: None)
    figures = summary(outcome, "trot", bundle.robot)
    assert figures.seconds == 4
    assert figures.distance > 1
    heights = outcome.truth["position"][:, 2]
    assert heights.max() > 0.25


def test_a_push_changes_the_bases_velocity_at_once() -> None:
    robot = Emulator()
    before = robot.world.data.qvel.copy()
    push(robot.world, (0.5, -0.25))
    np.testing.assert_allclose(robot.world.data.qvel - before, [0.5, -0.25] + [0] * 16)


@pytest.mark.parametrize("level", [-1, 10])
def test_a_level_that_is_not_there_is_refused(level: int) -> None:
    with pytest.raises(InputError, match=f"^--level {level}: expected 0 to 9$"):
        emulator("rough", level=level)


def test_a_served_robot_stands_there_too(tmp_path: Path) -> None:
    log, flags = tmp_path / "truth.npz", ("--ground", "downhill", "--level", "9")
    command = [sys.executable, "-m", "rmll_hil.cli", "serve", "--port", "0", *flags]
    with (
        subprocess.Popen([*command, "--log", str(log)], stdout=subprocess.PIPE) as process,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client,
    ):
        assert process.stdout
        host, port = process.stdout.readline().decode().split()[-1].rsplit(":", 1)
        client.settimeout(60)
        client.sendto(encode_command(MotorCommand()), (host, int(port)))
        assert client.recv(2048)
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
    with np.load(log) as saved:
        # on top of the pyramid
        assert saved["truth"]["position"][0, 2] > 5
