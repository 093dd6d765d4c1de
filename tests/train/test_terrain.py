"""The ground that robots feel is the ground that the trainer computes with."""

import mujoco
import numpy as np
import pytest
import torch

from rmll_gaits.load import load_gait
from rmll_robots import A1
from rmll_train.env.curriculum import TerrainCurriculum
from rmll_train.env.environment import GaitEnv
from rmll_train.env.simulation import training_model
from rmll_train.env.terrain import Terrain, build
from rmll_train.train_settings import EnvSettings, GroundSettings

ALL = GroundSettings(kinds=("rough", "uphill", "downhill", "stones"), levels=3, tile=4.0)


@pytest.fixture(scope="module")
def terrain() -> Terrain:
    return build(ALL, seed=0)


def test_heights_are_those_of_mujocos_triangles(terrain: Terrain) -> None:
    model = training_model(A1, terrain)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (300, 2)) * (np.array(terrain.field.radii) - 0.5)
    groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)  # the floor's, not the robot's
    robot = model.body("trunk").id
    for x, y in points:
        geom = np.zeros(1, np.int32)
        above = np.array([x, y, 5.0])
        distance = mujoco.mj_ray(
            model, data, above, np.array([0.0, 0.0, -1.0]), groups, 1, robot, geom, None
        )
        if model.geom(int(geom[0])).name != "floor":
            continue  # a foot of the robot stands in the way
        ours = float(terrain.height(torch.tensor([x]), torch.tensor([y])))
        assert 5.0 - distance == pytest.approx(ours, abs=2e-3)


def test_each_level_is_harder_than_the_one_before(terrain: Terrain) -> None:
    half = ALL.tile / 2
    for column in range(len(ALL.kinds)):
        spread = []
        for level in range(ALL.levels):
            x, y = terrain.centres[level, column]
            offset = torch.linspace(-half + 0.2, half - 0.2, 40)
            grid = torch.cartesian_prod(x + offset, y + offset)
            spread.append(float(terrain.height(grid[:, 0], grid[:, 1]).std()))
        assert spread == sorted(spread) and spread[0] > 0, ALL.kinds[column]


def test_robots_are_placed_with_no_foot_in_the_ground() -> None:
    env = GaitEnv(load_gait("trot"), A1, EnvSettings(envs=32, ground=ALL), seed=0)
    assert env.simulation.foot_height.min() > -1e-3
    assert env.simulation.foot_height.amin(1).max() < 1e-3


def test_a_robot_that_holds_its_gait_climbs_and_one_that_falls_descends(terrain: Terrain) -> None:
    levels = TerrainCurriculum(terrain, ALL, 5, torch.Generator().manual_seed(0))
    levels.level[:] = torch.tensor([1, 1, 1, 0, 1])
    # to the end, fell, to the end, fell, another limit
    whole = torch.tensor([True, False, True, False, False])
    fell = torch.tensor([False, True, False, True, False])
    levels.update(torch.arange(5), whole, fell, torch.tensor([0.95, 0.95, 0.5, 0.9, 0.95]))
    assert levels.level.tolist() == [2, 0, 1, 0, 1]


def test_who_masters_the_last_level_is_sent_to_any(terrain: Terrain) -> None:
    levels = TerrainCurriculum(terrain, ALL, 200, torch.Generator().manual_seed(0))
    levels.level[:] = ALL.levels - 1
    all_of_them = torch.ones(200, dtype=torch.bool)
    levels.update(torch.arange(200), all_of_them, ~all_of_them, torch.ones(200))
    assert set(levels.level.tolist()) == set(range(ALL.levels))
