"""The gait itself: contacts in, automaton and policy stepped, joint targets out.

No clock and no input or output, so the same class walks the robot, proves bundles and replays
logs. Arrays are in the policy's joint order.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rmll_common.errors import InputError
from rmll_contract import action, observation
from rmll_gaits import label
from rmll_gaits.adherence import GaitProgress
from rmll_gaits.label import FEET
from rmll_onboard.control.bundle import Bundle
from rmll_onboard.control.contact_estimator import ContactEstimator
from rmll_onboard.control.policy import Policy
from rmll_onboard.state.robot_state import RobotState

TRACE_TOLERANCE = 1e-4
"""Largest difference from the trainer's answers, as a share of the largest number in the answer or
of 1: other matrix kernels round differently, and a large sum is rounded more coarsely"""


class PolicyInput(NamedTuple):
    """What the robot measures for one policy step."""

    q: NDArray
    """(12,) joint angles [rad]"""
    dq: NDArray
    """(12,) joint speeds [rad/s]"""
    projected_gravity: NDArray
    """(3,) unit vector of gravity, base frame"""
    gyro: NDArray
    """(3,) angular velocity [rad/s], base frame"""


class Controller:
    """One gait. What the last :meth:`step` did can be read from the attributes."""

    def __init__(self, bundle: Bundle, feet: ContactEstimator | None = None) -> None:
        """``feet`` is where contacts come from on a robot; a recorded trace brings its own."""
        self.feet = feet
        contract, table = bundle.contract, bundle.table
        self._fields = contract.observation
        self._default_pose = np.array(contract.default_pose)
        self._scale, self._clip = contract.action_scale, contract.action_clip
        self._progress = GaitProgress(table)
        ranges = table.commands
        self._low, self._high = np.array([ranges.vx, ranges.wz, ranges.frequency]).T
        self._policy = Policy(bundle.session)
        self._one_hot = np.eye(table.num_states, dtype=np.float32)
        self.observation = np.zeros(observation.size(self._fields), np.float32)
        self.estimate = np.zeros(observation.size(contract.estimates), np.float32)
        self._foot_height = observation.find(contract.estimates, "foot_height")
        self.reset()

    def reset(self) -> None:
        """Begin an episode: the start state, all feet down, no action yet."""
        self._progress.reset()
        self.down = np.ones(len(FEET), bool)
        self.label = int(label.label(self.down))
        """Contact label, 0 to 15"""
        self.command = np.zeros(3)
        """vx [m/s], wz [rad/s], c_f [policy steps], as used: clamped to what was trained"""
        self.action = np.zeros(self._default_pose.size, np.float32)
        """As used: clipped"""
        self.raw_action = self.action
        """As the network gave it"""
        self.estimate[:] = 0
        self.target = self._default_pose.copy()
        """Joint targets [rad]"""

    @property
    def state(self) -> int:
        """State of the automaton, after the step"""
        return self._progress.state

    @property
    def phi(self) -> int:
        """Policy steps since the last transition"""
        return self._progress.phi

    @property
    def advanced(self) -> bool:
        """An edge of the gait was taken"""
        return self._progress.advanced

    @property
    def off_spec(self) -> bool:
        """Neither an edge nor a hold of the state before the step explains the label"""
        return self._progress.off_spec

    def contacts(
        self, state: RobotState, gravity: NDArray
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """``touching`` and ``clear`` (4,) for the :meth:`step` that follows.

        ``gravity`` (3,) is its unit vector in the base frame.
        """
        assert self.feet
        return self.feet.step(state, gravity, self.down, self.estimate[self._foot_height])

    def step(
        self,
        touching: NDArray[np.bool_],
        clear: NDArray[np.bool_],
        sensed: PolicyInput,
        command: ArrayLike,
    ) -> NDArray[np.float64]:
        """One policy step.

        Args:
            touching, clear: (4,) signals of the labelling function.
            sensed: now.
            command: (3,) vx [m/s], wz [rad/s], c_f [policy steps].

        Returns:
            Joint targets [rad] (12,), before any safety limit.
        """
        self.command = np.clip(command, self._low, self._high)
        self.down = label.hysteresis(self.down, touching, clear)
        self.label = int(label.label(self.down))
        self._progress.step(self.label, self.command[2])
        self.raw_action, self.estimate = self._run(sensed)
        self.action = self.raw_action.clip(-self._clip, self._clip)
        self.target = action.targets(self.action, self._default_pose, self._scale, self._clip)
        return self.target

    def _run(self, sensed: PolicyInput) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The network's action and estimate."""
        vx, wz, frequency = self.command
        observation.write(
            self.observation,
            self._fields,
            {
                "rm_state": self._one_hot[self.state],
                "phi": self.phi,
                "joint_position": sensed.q - self._default_pose,
                "joint_velocity": sensed.dq,
                "last_action": self.action,
                "command_vx": vx,
                "command_wz": wz,
                "command_frequency": frequency,
                "projected_gravity": sensed.projected_gravity,
                "angular_velocity": sensed.gyro,
            },
        )
        raw_action, estimate = self._policy.run(self.observation)
        # the network's buffers are overwritten by its next run
        return raw_action.copy(), estimate.copy()


def prove(bundle: Bundle) -> int:
    """Replay the golden trace and compare with what the trainer answered.

    Returns the number of steps compared. Raises InputError with the first step and field that
    differ: this machine, this runtime or this file is not what was trained. Each step sees the
    trainer's last action, as it sees the trainer's measurements: a loud policy, fed with its own,
    would make more of a last digit at every step.
    """
    contract, trace = bundle.contract, bundle.contract.trace
    answers = {
        "label": (trace.label, 0.0),
        "state": (trace.state, 0.0),
        "phi": (trace.phi, 0.0),
        "observation": (trace.observation, TRACE_TOLERANCE),
        "estimate": (trace.estimate, TRACE_TOLERANCE),
        # the trace has what the network answered, which may lie beyond the range of actions
        "raw_action": (trace.action, TRACE_TOLERANCE),
        "target": (trace.target, TRACE_TOLERANCE),
    }
    touching, clear = np.array(trace.touching, bool), np.array(trace.clear, bool)
    sensed = PolicyInput(
        np.array(trace.joint_position),
        np.array(trace.joint_velocity),
        np.array(trace.projected_gravity),
        np.array(trace.angular_velocity),
    )
    controller = Controller(bundle)
    steps = len(trace.label)
    for row in range(steps):
        now = PolicyInput(*(array[row] for array in sensed))
        controller.step(touching[row], clear[row], now, trace.command[row])
        theirs_raw = np.array(trace.action[row], np.float32)
        loudest = float(np.abs(theirs_raw).max())
        for name, (expected, tolerance) in answers.items():
            ours, theirs = np.asarray(getattr(controller, name)), np.asarray(expected[row])
            # a target is what is left of an action when the loudest ones are clipped
            largest = contract.action_scale * loudest if name == "target" else np.abs(theirs).max()
            allowed = tolerance * max(1.0, float(largest))
            # written so that NaN counts as a difference
            differs = ~(np.abs(ours - theirs) <= allowed)
            if differs.any():
                first = int(np.flatnonzero(differs)[0])
                raise InputError(
                    f"{bundle.source}: the golden trace does not reproduce: step {row}, "
                    f"{name}[{first}]: got {ours.flat[first]:.6g}, "
                    f"the trainer had {theirs.flat[first]:.6g}"
                )
        controller.action = theirs_raw.clip(-contract.action_clip, contract.action_clip)
    return steps
