"""Foot forces from joint torques, against MuJoCo."""

# pyright: reportAttributeAccessIssue=false

import mujoco
import numpy as np
import pytest

from rmll_onboard.leg_force import LegForce
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
    found = LegForce(A1).static(q, tau[6:], gravity)
    np.testing.assert_allclose(found, forces[:, 2], atol=1e-9)


def test_the_leg_of_the_facts_has_the_models_inertia(model):
    data = mujoco.MjData(model)
    data.qpos[3], data.qpos[7:] = 1.0, A1.stand_pose
    mujoco.mj_forward(model, data)
    diagonal = np.zeros(12)
    for joint in range(12):
        unit, column = np.zeros(model.nv), np.zeros(model.nv)
        unit[6 + joint] = 1.0
        mujoco.mj_mulM(model, data, column, unit)
        diagonal[joint] = column[6 + joint]
    np.testing.assert_allclose(diagonal, np.tile(A1.leg.inertia, 4), atol=1e-4)


def test_what_a_joint_needs_to_accelerate_does_not_count():
    force = LegForce(A1)
    tau = np.zeros(12)
    tau[2] = A1.leg.inertia[2] * 100.0
    force.step(0, A1.stand_pose, np.zeros(12), np.zeros(12), DOWN)
    dq = np.zeros(12)
    dq[2] = 0.5  # 100 rad/s² in 5 ms
    found = force.step(5_000_000, A1.stand_pose, dq, tau, DOWN)
    np.testing.assert_allclose(found, 0.0, atol=1e-9)
    assert abs(force.static(A1.stand_pose, tau, DOWN)[0]) > 5.0


def test_a_stretched_leg_tells_nothing():
    q = np.zeros(12)
    assert LegForce(A1).static(q, np.ones(12), DOWN).tolist() == [0.0] * 4
