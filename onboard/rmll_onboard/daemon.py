"""All that the robot's runtime does between one datagram and the next; only time is left out.

:meth:`Daemon.tick` takes the newest datagram from the robot and gives the one to send. The loop
calls it in real time, a simulation in step with its own clock, a replay with a log.
"""

from typing import Any

import numpy as np

from rmll_gaits.schedule import transition_rate
from rmll_onboard import remote
from rmll_onboard.a1_wire import BadPacket, RobotState, decode_state, encode_command
from rmll_onboard.attitude import projected_gravity
from rmll_onboard.bundle import Bundle
from rmll_onboard.controller import Controller
from rmll_onboard.foot_contact import FootContact
from rmll_onboard.log import Log
from rmll_onboard.pilot import Orders, Pilot
from rmll_onboard.settings import Settings
from rmll_onboard.supervisor import NS, Mode, Request, Supervisor


class Daemon:
    """One gait on one robot."""

    def __init__(
        self, bundle: Bundle, settings: Settings, pilot: Pilot, log: Log | None = None
    ) -> None:
        contract = bundle.contract
        self.period = NS // contract.control_hz
        """[ns] between two ticks"""
        self.policy_ran = False
        """The last tick was one of the policy's"""
        self.received = self.rejected = self.lost = 0
        """Datagrams believed and refused; ticks without a new state after the first one"""
        self.stopping = False
        """Sit down and finish, whatever the pilot wants; set it to stop"""
        self._pilot = pilot
        self._log = log
        self._joints = bundle.joints
        self._decimation = contract.control_hz // contract.policy_hz
        self._countdown = 0
        self._state = RobotState()
        self._feet = FootContact(settings.feet)
        self._controller = Controller(bundle)
        walk_pose = np.empty(len(self._joints))
        walk_pose[self._joints] = contract.default_pose
        self._target = walk_pose.copy()
        self._supervisor = Supervisor(
            bundle.robot, settings, walk_pose, (contract.kp, contract.kd), contract.torque_limit
        )
        self._walk = _Walk(bundle)
        self._halt = _Halt(settings.motion.slow_down)

    def tick(self, now: int, datagram: bytes | None) -> bytes:
        """Answer one datagram (None: none came) at ``now`` [ns, monotonic]; never raises."""
        state, supervisor = self._state, self._supervisor
        fresh = self._read(datagram)
        gravity = projected_gravity(state.quaternion)
        pressed = remote.decode(state.remote)
        if pressed.emergency_stop:
            supervisor.trip("emergency stop on the remote")
        before = supervisor.mode
        orders = self._pilot.orders(now, before, pressed)
        if self.stopping:
            orders = orders._replace(request=Request.SIT)
        orders = self._halt.ease(now, before, orders)
        mode = supervisor.update(now, state, fresh, gravity, orders.request)
        if mode is Mode.WALKING and before is not Mode.WALKING:
            self._controller.reset()
            self._feet.reset()
            self._countdown = 0
        due = self._countdown == 0
        self._countdown = (self._countdown or self._decimation) - 1
        self.policy_ran = due and mode is Mode.WALKING
        if self.policy_ran:
            self._step_policy(gravity, orders.command)
            if not self._halt.under_way:
                self._walk.count(now, self._controller)
        command = supervisor.command(now, state, self._target)
        if due and self._log is not None:
            self._log.append(now, supervisor.mode, self._controller)
        return encode_command(command)

    def damping(self) -> bytes:
        """The datagram that damps all joints, whatever else is going on."""
        return encode_command(self._supervisor.damping())

    @property
    def finished(self) -> bool:
        """The program may end: the robot lies damped and nobody wants more of it."""
        mode, fault = self._supervisor.mode, self._supervisor.fault
        stopped = self.stopping and mode is Mode.DAMPING
        return stopped or self._pilot.finished(mode, fault)

    @property
    def fault(self) -> str | None:
        return self._supervisor.fault

    def report(self) -> dict[str, Any]:
        """What was walked, and the fault that ended it, as plain numbers."""
        return self._walk.report() | {"fault": self.fault}

    def _read(self, datagram: bytes | None) -> bool:
        if datagram is not None:
            try:
                decode_state(datagram, self._state)
            except BadPacket:
                self.rejected += 1
            else:
                self.received += 1
                return True
        self.lost += self.received > 0
        return False

    def _step_policy(self, gravity: np.ndarray, command: tuple[float, float, float]) -> None:
        state, joints = self._state, self._joints
        touching, clear = self._feet.step(state.foot_force)
        self._target[joints] = self._controller.step(
            touching, clear, state.q[joints], state.dq[joints], gravity, state.gyro, command
        )


class _Halt:
    """The way out of walking: some steps on the spot first, for at speed the robot tips over."""

    def __init__(self, seconds: float) -> None:
        self._duration = int(seconds * NS)
        self._since: int | None = None
        self._then = Request.STAND

    @property
    def under_way(self) -> bool:
        return self._since is not None

    def ease(self, now: int, mode: Mode, orders: Orders) -> Orders:
        """The orders to follow instead. WALK calls a halt off; a fault does not ask for one."""
        if mode is not Mode.WALKING or orders.request is Request.WALK:
            self._since = None
        elif orders.request is not None:
            self._since = now if self._since is None else self._since
            self._then = orders.request
        if self._since is None:
            return orders
        _, _, frequency = orders.command
        over = now - self._since >= self._duration
        return Orders(self._then if over else None, (0.0, 0.0, frequency))


class _Walk:
    """Counts of all policy steps so far, those of a halt left out."""

    def __init__(self, bundle: Bundle) -> None:
        self._table = bundle.table
        self._rate = 0.0, transition_rate(bundle.table, bundle.table.commands.frequency[0])
        self._start: int | None = None
        self._end: int | None = None
        self._steps = self._transitions = self._off_spec = 0
        self._allowed = 0.0

    def count(self, now: int, controller: Controller) -> None:
        self._start = now if self._start is None else self._start
        self._end = now
        self._steps += 1
        self._transitions += controller.advanced
        self._off_spec += controller.off_spec
        frequency = float(controller.command[2])
        if frequency != self._rate[0]:
            self._rate = frequency, float(transition_rate(self._table, frequency))
        self._allowed += self._rate[1]

    def report(self) -> dict[str, Any]:
        steps = self._steps
        return {
            "walking_start_ns": self._start,
            "walking_end_ns": self._end,
            "policy_steps": steps,
            "transitions": self._transitions,
            "allowed": self._allowed,
            "adherence": self._transitions / self._allowed if steps else None,
            "off_spec_contact": self._off_spec / steps if steps else None,
        }
