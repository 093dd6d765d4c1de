"""Contact labels from forces and heights: one step of memory, and air time."""

from types import SimpleNamespace
from typing import cast

import torch

from rmll_train.env.labelling import Contacts
from rmll_train.env.simulation import Simulation
from rmll_train.train_settings import EnvSettings

DT = 0.02
CLEARANCE = 0.03
FORCE = EnvSettings().contact_force
AIR, LOW = (0.0, CLEARANCE), (0.0, CLEARANCE - 0.001)
TOUCH, GRAZE = (FORCE + 0.1, 0.0), (FORCE - 0.1, 0.0)
ALL = 15


def contacts() -> Contacts:
    return Contacts(1, EnvSettings(), DT)


def see(watched: Contacts, *feet: tuple[float, float]) -> tuple[int, list[float]]:
    """The label after a step in which each foot has so much force and height; and landings."""
    force, height = torch.tensor(feet).T[:, None]
    seen = cast(Simulation, SimpleNamespace(foot_force=force, foot_height=height))
    landed = watched.observe(seen, CLEARANCE)
    return int(watched.label), landed[0].tolist()


def test_a_foot_that_lifts_is_up_after_one_step_of_memory() -> None:
    watched = contacts()
    assert see(watched, AIR, TOUCH, TOUCH, TOUCH)[0] == ALL
    assert see(watched, AIR, TOUCH, TOUCH, TOUCH)[0] == ALL - 1


def test_a_foot_that_is_unloaded_but_low_is_not_up() -> None:
    watched = contacts()
    for _ in range(5):
        assert see(watched, LOW, TOUCH, TOUCH, TOUCH)[0] == ALL


def test_a_foot_that_comes_down_counts_at_once_and_only_if_it_presses() -> None:
    watched = contacts()
    for _ in range(3):
        see(watched, TOUCH, TOUCH, AIR, TOUCH)
    assert see(watched, TOUCH, TOUCH, GRAZE, TOUCH)[0] == ALL - 4
    assert see(watched, TOUCH, TOUCH, TOUCH, TOUCH)[0] == ALL


def test_air_time_is_told_in_the_step_that_lands() -> None:
    watched = contacts()
    see(watched, TOUCH, AIR, TOUCH, TOUCH)
    for _ in range(4):
        assert see(watched, TOUCH, AIR, TOUCH, TOUCH)[1] == [0.0] * 4
    _, landed = see(watched, TOUCH, TOUCH, TOUCH, TOUCH)
    assert landed[1] == torch.tensor(4 * DT)
    assert landed[0] == landed[2] == landed[3] == 0.0
    assert see(watched, TOUCH, TOUCH, TOUCH, TOUCH)[1] == [0.0] * 4


def test_an_episode_begins_on_all_feet() -> None:
    watched = contacts()
    for _ in range(3):
        see(watched, AIR, AIR, AIR, AIR)
    assert int(watched.label) == 0
    watched.begin(torch.tensor([0]))
    assert int(watched.label) == ALL
    assert see(watched, AIR, AIR, AIR, AIR) == (ALL, [0.0] * 4)
