"""Mirrored observations and actions: each number goes where the mirror puts it."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import InputError
from rmll_contract import observation
from rmll_contract.mirror import Mirror, mirror_action, mirror_layout
from rmll_gaits.load import library_names, load_gait
from rmll_gaits.symmetry import mirror_states
from rmll_robots import A1

ACTION = mirror_action(A1)


def image(vector: np.ndarray, mirror: Mirror) -> np.ndarray:
    return vector[..., mirror.source] * mirror.sign


def mirrored(parts: dict[str, np.ndarray], states: tuple[int, ...]) -> dict[str, np.ndarray]:
    """The ``imu`` observation with these parts, the rest zero, mirrored and taken apart again."""
    fields = observation.layout("imu", len(states))
    zero = {field.name: np.zeros(field.size) for field in fields}
    vector = observation.write(np.zeros(observation.size(fields)), fields, zero | parts)
    flat, found, start = image(vector, mirror_layout(fields, states)), {}, 0
    for field in fields:
        found[field.name] = flat[start : start + field.size] / field.scale
        start += field.size
    return found


@given(st.sampled_from(library_names()), st.sampled_from(["paper", "imu"]), st.integers(0, 999))
def test_the_image_of_the_image_is_the_observation(gait, profile, seed):
    states = mirror_states(load_gait(gait))
    if states is None:
        return
    fields = observation.layout(profile, len(states)) + observation.ESTIMATES
    mirror = mirror_layout(fields, states)
    vector = np.random.default_rng(seed).normal(size=(3, observation.size(fields)))
    assert np.array_equal(image(image(vector, mirror), mirror), vector)
    assert sorted(mirror.source) == list(range(observation.size(fields)))


@given(st.integers(0, 999))
def test_the_image_of_the_image_is_the_action(seed):
    action = np.random.default_rng(seed).normal(size=(3, 12))
    assert np.array_equal(image(image(action, ACTION), ACTION), action)


def test_states_change_places():
    states = mirror_states(load_gait("walk"))
    for state, other in enumerate(states):
        assert mirrored({"rm_state": np.eye(4)[state]}, states)["rm_state"].argmax() == other


def test_legs_change_places_and_hips_change_sign():
    for name in ("joint_position", "joint_velocity", "last_action"):
        found = mirrored({name: np.arange(1.0, 13.0)}, (1, 0))[name]
        assert np.allclose(found, [-4, 5, 6, -1, 2, 3, -10, 11, 12, -7, 8, 9])


def test_a_left_turn_becomes_a_right_turn_at_the_same_speed():
    commands = {"command_vx": 0.7, "command_wz": 0.4, "command_frequency": 8.0}
    found = mirrored({name: np.array([value]) for name, value in commands.items()}, (1, 0))
    assert [found[name].item() for name in commands] == pytest.approx([0.7, -0.4, 8.0])


def test_a_lean_to_the_left_becomes_one_to_the_right():
    turn = {"projected_gravity": np.array([0.1, 0.2, -0.9]), "angular_velocity": np.arange(1, 4.0)}
    found = mirrored(turn, (1, 0))
    assert np.allclose(found["projected_gravity"], [0.1, -0.2, -0.9])
    assert np.allclose(found["angular_velocity"], [-1, 2, -3])


def test_every_pose_and_limit_of_the_a1_is_mirror_symmetric():
    for pose in (A1.default_pose, A1.stand_pose, A1.crouch_pose):
        assert np.allclose(image(pose, ACTION), pose)
    assert np.allclose(image((A1.joint_lower + A1.joint_upper) / 2, ACTION).reshape(4, 3)[:, 0], 0)


def test_a_robot_that_stands_crooked_is_refused():
    pose = A1.default_pose.copy()
    pose[0] += 0.05
    with pytest.raises(InputError, match="FR_hip_joint"):
        mirror_action(dataclasses.replace(A1, default_pose=pose))
