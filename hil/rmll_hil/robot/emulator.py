"""The emulated robot: datagrams in, physics, datagrams out, and the truth that no robot tells."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled module has no stubs)

import copy
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from rmll_common.errors import Failure
from rmll_common.flag import within
from rmll_hil.robot.fault_injection import FaultInjector
from rmll_hil.robot.fault_plan import Plan
from rmll_hil.robot.lossy_channel import LossyChannel
from rmll_hil.robot.motor_board import MotorBoard
from rmll_hil.robot.robot_packets import A1Robot, RobotPackets
from rmll_hil.robot.sensors import FootUnits, Noise, Sensors
from rmll_hil.robot.world import STEP_MS, World, load
from rmll_onboard.state.packet_errors import BadPacket
from rmll_onboard.state.robot_state import RobotState
from rmll_robots import A1, Robot
from rmll_robots.ground import LEVELS, HeightField, Kind, build, course

TRUTH = np.dtype(
    [
        ("time_ns", "i8"),
        ("position", "f8", 3),
        ("velocity", "f8", 3),
        ("yaw_rate", "f8"),
        ("energy", "f8"),
        ("contact", "?", 4),
        ("grounded", "?"),
    ]
)
"""A sample of the truth: the caller's clock; the base's position [m] in the world and velocity
[m/s] in its own frame; yaw rate [rad/s]; the sum of |torque x speed| dt of all joints so far [J];
which feet touch (FR FL RR RL); whether the base touches the ground."""

TRUTH_MS = 5
CONTACT_FORCE = 1.0
"""[N] a foot touches above it, as in the paper's code"""
SETTLE_MS = 3000
"""Until a robot has sunk into its rest, before its time begins"""
_AT_REST: dict[tuple, mujoco.MjData] = {}
"""Robots that have sunk into their rest on a flat floor, to be copied: many trials begin there"""
_DIVERGED = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True)
class EmulatorSettings:
    """What may differ from one emulated robot to the next."""

    seed: int = 0
    """Of all randomness: sensor noise, biases, drift, ground."""
    friction: float = 0.8
    """Sliding friction coefficient of feet and floor."""
    action_delay_ms: int = 5
    """From the arrival of a command to its effect at the joints."""
    command_timeout_ms: int = 50
    """Without a command for longer, the joints brake. The A1's own value is not published."""
    ground: Literal["flat", Kind] = "flat"
    """What it stands on: rough is random heights; uphill and downhill lead away from the start."""
    level: int = 5
    """How hard the ground is, from 0 to 9, as in training; without effect on flat ground."""

    def check(self) -> None:
        """Raises InputError, which names the flag, for a value out of its range."""
        within("seed", self.seed, 0)
        within("friction", self.friction, 0.01, 10)
        within("action-delay-ms", self.action_delay_ms, 0, 1000)
        within("command-timeout-ms", self.command_timeout_ms, 1, 100_000)
        within("level", self.level, 0, LEVELS - 1)


class Emulator:
    """One robot, lying on the floor with braked joints until it is commanded.

    It has no clock of its own: its time is what :meth:`advance` has added up.
    """

    def __init__(
        self,
        settings: EmulatorSettings | None = None,
        noise: Noise | None = None,
        robot: Robot = A1,
        plan: Plan = (),
        wire: RobotPackets | None = None,
        feet: FootUnits = FootUnits(),  # noqa: B008 - frozen
    ) -> None:
        """``plan`` is for a wire that speaks like an A1, as the default one does."""
        settings = settings or EmulatorSettings()
        settings.check()
        self._robot = robot
        self.world: World = load(robot, settings.friction, _field(settings))
        self.wire = wire or A1Robot()
        delay_ms, timeout_ms = settings.action_delay_ms, settings.command_timeout_ms
        self.board = MotorBoard(self.world, robot, delay_ms, timeout_ms, self.wire.passive_kd)
        self.now_ms = 0
        self.received = 0
        self.rejected = 0
        self.sent = 0
        self._energy = 0.0
        self._truth: list[tuple] = []
        self._injector = FaultInjector((), self.world, self.board, robot)
        self._settle(settings)
        rng = np.random.default_rng(settings.seed)
        self.sensors = Sensors(self.world, noise or Noise(), rng, feet)
        self._injector = FaultInjector(plan, self.world, self.board, robot)
        # randomness of its own, so that a plan does not change the sensors' noise
        chance = np.random.default_rng((settings.seed, 1))
        self.to_robot = LossyChannel(plan, "to_robot", chance)
        """For whoever brings datagrams here; :meth:`receive` itself is the far end"""
        self.from_robot = LossyChannel(plan, "from_robot", chance)

    def _settle(self, settings: EmulatorSettings) -> None:
        """Sink into the rest; time begins after it."""
        world = self.world
        key = self._robot.name, settings.friction, self.wire.passive_kd
        if settings.ground == "flat" and key in _AT_REST:
            mujoco.mj_copyData(world.data, world.model, _AT_REST[key])
            return
        self.advance(SETTLE_MS, -SETTLE_MS * 1_000_000)
        self.now_ms, self._energy, self._truth = 0, 0.0, []
        if settings.ground == "flat":
            _AT_REST[key] = copy.copy(world.data)

    def follow(self, plan: Plan) -> None:
        """Have another plan from now on; its times are of the robot's clock."""
        self._injector = FaultInjector(plan, self.world, self.board, self._robot)
        self.world.data.xfrc_applied[:] = 0.0  # a push that the plan before has not ended
        self.to_robot.follow(plan)
        self.from_robot.follow(plan)

    @property
    def accepted(self) -> int:
        """Good datagrams so far."""
        return self.received - self.rejected

    def receive(self, datagram: bytes) -> bool:
        """Take a datagram from the network; a bad one is counted and dropped, answer False."""
        self.received += 1
        try:
            command = self.wire.hear(datagram, self._measure)
        except BadPacket:
            self.rejected += 1
            return False
        self.board.receive(command, self.now_ms)
        return True

    def state_datagram(self) -> bytes:
        """Measure, and return what the board sends."""
        self.sent += 1
        return self._injector.rewrite(self.wire.tell(self._measure()), self.now_ms)

    def advance(self, milliseconds: int, time_ns: int) -> None:
        """Let time pass; ``time_ns`` is the caller's clock at the beginning, for the truth.

        Raises Failure if the physics diverges.
        """
        world = self.world
        for passed in range(0, milliseconds, STEP_MS):
            if self.now_ms % TRUTH_MS == 0:
                self._truth.append(self._sample(time_ns + passed * 1_000_000))
            self.board.update(self.now_ms)
            self._injector.before_step(self.now_ms)
            mujoco.mj_step(world.model, world.data)
            self._energy += float(np.abs(world.torque) @ np.abs(world.dq)) * STEP_MS * 1e-3
            self.now_ms += STEP_MS
            if self.now_ms % TRUTH_MS == 0:
                self._check_physics()

    def _check_physics(self) -> None:
        warnings = self.world.data.warning
        if any(warnings[kind].number for kind in _DIVERGED):
            raise Failure(f"the physics diverged after {self.now_ms} ms")

    def truth(self) -> NDArray[np.void]:
        """All samples so far, one each 5 ms, of type ``TRUTH``."""
        return np.array(self._truth, TRUTH)

    def _measure(self) -> RobotState:
        state = self.sensors.read(self.board.mode, self.now_ms)
        self._injector.distort(state, self.now_ms)
        return state

    def _sample(self, time_ns: int) -> tuple:
        world = self.world
        base_to_world = np.empty(9)
        mujoco.mju_quat2Mat(base_to_world, world.data.qpos[3:7])
        return (
            time_ns,
            world.data.qpos[:3].copy(),
            world.data.qvel[:3] @ base_to_world.reshape(3, 3),
            world.data.qvel[5],
            self._energy,
            world.foot_load > CONTACT_FORCE,
            world.base_contact[0] > 0,
        )


def _field(settings: EmulatorSettings) -> HeightField | None:
    """The ground's heights, None for a flat floor."""
    if settings.ground == "flat":
        return None
    return build(course(settings.ground, settings.level), settings.seed)
