"""The gait without a robot: automaton, observation, action."""

import numpy as np
import pytest

from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.control.controller import Controller, PolicyInput

TROT = 6, 9
ALL = 15


@pytest.fixture
def controller(bundle):
    return Controller(bundle)


def step(controller, label, command=(0.5, 0.0, 6.0), gyro=(0.0, 0.0, 0.0), q=None):
    touching = np.array([bool(label >> foot & 1) for foot in range(4)])
    return controller.step(
        touching,
        ~touching,
        PolicyInput(
            controller.target * 0 + 0.1 if q is None else q,
            np.zeros(12),
            np.array([0.0, 0.0, -1.0]),
            np.array(gyro),
        ),
        command,
    )


def test_the_first_step_only_looks(controller):
    step(controller, TROT[0])
    assert (controller.label, controller.state, controller.phi) == (TROT[0], 0, 0)
    assert not controller.advanced
    step(controller, TROT[0])
    assert controller.phi == 1


def test_an_edge_opens_after_c_f_steps(controller):
    transitions = []
    for count in range(40):
        step(controller, TROT[controller.state], command=(0, 0, 6))
        if controller.advanced:
            transitions.append(count)
            assert controller.phi == 0
    assert transitions == [6, 12, 18, 24, 30, 36]
    assert not controller.off_spec


def test_a_foot_between_the_thresholds_keeps_its_bit(controller):
    step(controller, TROT[0])
    nothing = np.zeros(4, bool)
    still = PolicyInput(np.zeros(12), np.zeros(12), np.zeros(3), np.zeros(3))
    controller.step(nothing, nothing, still, (0, 0, 6))
    assert controller.label == TROT[0]
    controller.step(nothing, ~nothing, still, (0, 0, 6))
    assert controller.label == 0


def test_what_a_step_answered_stays_when_the_next_one_comes(controller):
    step(controller, ALL)
    kept = controller.estimate, controller.raw_action, controller.action, controller.target
    copies = [array.copy() for array in kept]
    step(controller, TROT[0], q=np.full(12, 0.5))
    assert not np.array_equal(controller.estimate, copies[0])
    for array, copy in zip(kept, copies, strict=True):
        assert np.array_equal(array, copy)


def test_a_label_that_leads_to_the_sink_is_off_spec_and_waits(controller):
    for _ in range(8):
        step(controller, TROT[controller.state])
    assert (controller.state, controller.phi) == (1, 1)
    step(controller, ALL)
    assert (controller.state, controller.phi) == (1, 2)
    assert controller.off_spec
    step(controller, TROT[0])  # holding the pose is as it should be
    assert not controller.off_spec


def test_observation_has_its_parts_in_place_and_scaled(controller):
    q = np.linspace(0.0, 1.1, 12)
    target = step(controller, ALL, (0.5, -0.25, 8), gyro=(1, 2, 3), q=q).copy()
    action = controller.action.copy()
    step(controller, ALL, (0.5, -0.25, 8), gyro=(1, 2, 3), q=q)
    seen = controller.observation
    start = 4  # three states and phi
    assert seen[:start].tolist() == pytest.approx([1, 0, 0, 0.1])
    default = target - 0.25 * action
    np.testing.assert_allclose(seen[start : start + 12], q - default, atol=1e-6)
    np.testing.assert_array_equal(seen[start + 24 : start + 36], action)
    np.testing.assert_allclose(seen[start + 36 :], [0.5, -0.25, 0.8, 0, 0, -1, 0.25, 0.5, 0.75])


def test_commands_are_clamped_to_what_was_trained(controller):
    step(controller, ALL, command=(9, -9, 99))
    assert controller.command.tolist() == [1, -1, 12]
    step(controller, ALL, command=(-9, 9, 0))
    assert controller.command.tolist() == [-1, 1, 6]


def test_actions_are_clipped_and_seen_clipped(make_bundle):
    controller = Controller(load_bundle(make_bundle(action_clip=0.01, action_scale=2.0)))
    target = step(controller, ALL).copy()
    assert np.abs(controller.action).max() == np.float32(0.01)
    assert np.abs(target - controller.target).max() == 0
    step(controller, ALL)
    assert np.abs(controller.observation[28:40]).max() == np.float32(0.01)


def test_reset_forgets(controller):
    fresh = [step(controller, TROT[count // 7 % 2]).copy() for count in range(20)]
    controller.reset()
    again = [step(controller, TROT[count // 7 % 2]).copy() for count in range(20)]
    np.testing.assert_array_equal(fresh, again)
