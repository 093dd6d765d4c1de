"""Foot forces from joint torques, against MuJoCo."""

# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
import pytest

from rmll_onboard.control.leg_force import LegForce
from rmll_robots import A1

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_path(str(A1.scene))


@pytest.mark.parametrize("seed", range(5))
def test_a_force_on_a_foot_is_found_in_the_torques_that_hold_it(model, seed):
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    q = (A1.stand_pose + random.normal(0, 0.3, 12)).clip(A1.joint_lower, A1.joint_upper)
    turn = random.normal(0, 0.3, 3)
    mujoco.mju_quatIntegrate(data.qpos[3:7], turn, 1.0)
    data.qpos[7:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    forces = random.normal(0, 50, (4, 3))
    tau = np.zeros(model.nv)
    for foot, force in zip(A1.foot_names, forces, strict=True):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, model.site(f"{foot}_foot").id)
        tau -= jacobian.T @ force
    gravity = data.body("trunk").xmat.reshape(3, 3).T @ DOWN
    legs = LegForce(A1)
    found = legs.step(q, tau[6:], gravity)
    np.testing.assert_allclose(found, forces[:, 2], atol=1e-9)
    feet = [data.site(f"{foot}_foot").xpos[2] for foot in A1.foot_names]
    hips = [data.body(f"{foot}_hip").xpos[2] for foot in A1.foot_names]
    np.testing.assert_allclose(legs.heights, np.subtract(feet, hips), atol=1e-9)


@pytest.mark.parametrize("calf", [-1.0, -1.6, -2.3])
def test_the_leg_of_the_facts_has_the_models_inertia(model, calf):
    data = mujoco.MjData(model)
    data.qpos[3], data.qpos[7:] = 1.0, np.tile([0.0, 0.8, calf], 4)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((3, 3))
    for joint in range(3):
        unit, column = np.zeros(model.nv), np.zeros(model.nv)
        unit[6 + joint] = 1.0
        mujoco.mj_mulM(model, data, column, unit)
        inertia[joint] = column[6:9]
    leg = A1.leg
    bend = leg.bend_inertia * np.cos(calf)
    both = leg.calf_on_thigh + bend
    planar = [[leg.thigh_inertia + 2 * bend, both], [both, leg.calf_inertia]]
    np.testing.assert_allclose(inertia[1:, 1:], planar, atol=2e-4)
    assert inertia[0, 0] == pytest.approx(leg.hip_inertia, rel=0.3)


def test_what_a_leg_needs_to_accelerate_does_not_count(model):
    """A leg that swings, on a base that is held: its torques are those of no foot on the ground."""
    data = mujoco.MjData(model)
    acceleration = np.array([20.0, -150.0, 300.0])
    data.qpos[3], data.qpos[7:] = 1.0, A1.stand_pose
    mujoco.mj_forward(model, data)
    column, needed = np.zeros(model.nv), np.zeros(model.nv)
    needed[6:9] = acceleration
    mujoco.mj_mulM(model, data, column, needed)
    tau = np.zeros(12)
    tau[:3] = column[6:9]
    force, dq = LegForce(A1), np.zeros(12)
    force.turn(0, dq)
    dq[:3] = 0.005 * acceleration
    force.turn(5_000_000, dq)
    assert abs(force.step(A1.stand_pose, tau, DOWN)[0]) < 4.0
    assert abs(LegForce(A1).step(A1.stand_pose, tau, DOWN)[0]) > 10.0


def test_two_states_of_one_moment_give_no_acceleration():
    force = LegForce(A1)
    force.turn(0, np.zeros(12))
    force.turn(10, np.ones(12))
    tau = np.ones(12)
    resting = LegForce(A1).step(A1.stand_pose, tau, DOWN)
    assert force.step(A1.stand_pose, tau, DOWN) == resting


def test_a_stretched_leg_tells_nothing():
    q = np.zeros(12)
    assert LegForce(A1).step(q, np.ones(12), DOWN) == [0.0] * 4
