"""All that the robot's runtime does between one datagram and the next; only time is left out.

:meth:`Daemon.tick` takes the newest datagram from the robot and gives the one to send. The loop
calls it in real time, a simulation in step with its own clock, a replay with a log.
"""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import asdict

from rmll_gaits.schedule import transition_rate
from rmll_onboard.commands.operator import Operator, OperatorCommand
from rmll_onboard.control.bundle import Bundle
from rmll_onboard.control.command_limiter import CommandRateLimiter
from rmll_onboard.control.controller import Controller, PolicyInput
from rmll_onboard.interface.robot_interface import open_interface
from rmll_onboard.protocol import a1_remote
from rmll_onboard.safety.faults import Complaint, Fault
from rmll_onboard.safety.gait_monitor import GaitMonitor
from rmll_onboard.safety.guard import ActionGuard, Guard, SafetyInput
from rmll_onboard.safety.remote_watchdog import RemoteWatchdog
from rmll_onboard.safety.stop_sequence import StopSequence
from rmll_onboard.safety.supervisor import Supervisor
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.attitude import projected_gravity
from rmll_onboard.state.modes import NS, Mode, Request
from rmll_onboard.state.reports import DaemonReport, WalkReport

_REFUSAL_NS = 2_000_000_000
"""A robot that shall stand up waits so long for its sensors to agree"""


class Daemon:
    """One gait on one robot."""

    def __init__(self, bundle: Bundle, settings: RuntimeSettings, operator: Operator) -> None:
        contract = bundle.contract
        self.period = NS // contract.control_hz
        """[ns] between two ticks"""
        self.policy_ran = False
        """The last tick was one of the policy's"""
        self.due = False
        """It was at the policy's rate, walking or not"""
        self.orders = OperatorCommand(None, (0.0, 0.0, 0.0))
        """What the operator wanted at the last tick"""
        self.interface = open_interface(settings, bundle.robot)
        """The robot's newest state, and counts of what came"""
        self.stopping = False
        """Sit down and finish, whatever the operator wants; set it to stop"""
        self.operator = operator
        self._joints = bundle.joints
        self._decimation = contract.control_hz // contract.policy_hz
        self._countdown = 0
        self.feet = self.interface.contact_estimator(settings.feet)
        """Which feet touch the ground"""
        self.controller = Controller(bundle, self.feet)
        walk_pose = np.empty(len(self._joints))
        walk_pose[self._joints] = contract.default_pose
        self._target = walk_pose.copy()
        self._supervisor = Supervisor(
            bundle.robot, settings, walk_pose, (contract.kp, contract.kd), contract.torque_limit
        )
        safety = settings.safety
        self._guard = Guard(bundle.robot, safety, self.interface, self.period)
        self._action_guard = ActionGuard(contract.action_clip, safety.action_steps)
        self._monitor = GaitMonitor(bundle.table, safety.stuck)
        self._watchdog = RemoteWatchdog(safety, settings.steering.deadband)
        self._unready_since: int | None = None
        self._walk = WalkStatistics(bundle)
        self._stop = StopSequence(bundle.table, settings.motion.slow_down)
        self._limiter = CommandRateLimiter(
            bundle.table.commands, settings.steering, contract.policy_hz
        )

    def tick(self, now: int, datagrams: Sequence[bytes]) -> bytes:
        """Answer what came since the last call, at ``now`` [ns, monotonic]; never raises."""
        state, supervisor = self.interface.state, self._supervisor
        fresh = self.interface.take(now, datagrams, resting=supervisor.mode is Mode.DAMPING)
        gravity = projected_gravity(state.quaternion)
        if fresh:
            self.feet.measured(now, state.dq)
        pressed = a1_remote.decode(state.remote)
        if pressed.emergency_stop:
            supervisor.trip(Complaint(Fault.EMERGENCY_STOP, "emergency stop on the remote"))
        if self.interface.fault:
            supervisor.trip(Complaint(Fault.ROBOT_REPORTS, self.interface.fault))
        before = supervisor.mode
        orders = self._ready(now, before, self._orders(now, before, pressed))
        moving, walking = before is not Mode.DAMPING, before is Mode.WALKING
        seen = SafetyInput(now, state, fresh, gravity, moving, walking)
        complaint = self._guard.complaint(seen)
        mode = supervisor.update(now, state, orders.request)
        if complaint:
            mode = supervisor.trip(complaint)
        if mode is Mode.WALKING and before is not Mode.WALKING:
            self.controller.reset()
            self.feet.reset()
            self._limiter.reset(orders.command)
            self._countdown = 0
        self.due = self._countdown == 0
        self._countdown = (self._countdown or self._decimation) - 1
        self.policy_ran = self.due and mode is Mode.WALKING
        if self.policy_ran:
            self._step_policy(gravity, self._limiter.step(orders.command))
            if not self._stop.under_way:
                self._walk.count(now, self.controller)
        elif self.due and self.interface.received:
            self.feet.rest(mode, state, gravity)
        command = supervisor.command(now, state, self._target)
        self._guard.actuators.sent(command)
        return self.interface.opening() or self.interface.encode(command)

    @property
    def policy_next(self) -> bool:
        """The next tick will be one of the policy's, as far as one can tell."""
        return self._countdown == 0 and self._supervisor.mode is Mode.WALKING

    def damping(self) -> bytes:
        """The datagram that damps all joints, whatever else is going on."""
        return self.interface.encode(self._supervisor.damping())

    def warn(self, text: str) -> None:
        """Keep what is no fault, but should be in the report."""
        self._guard.warn(text)

    @property
    def finished(self) -> bool:
        """The program may end: the robot lies damped and nobody wants more of it."""
        mode, fault = self._supervisor.mode, self.fault
        stopped = self.stopping and mode is Mode.DAMPING
        return stopped or self.operator.finished(mode, fault)

    @property
    def mode(self) -> Mode:
        return self._supervisor.mode

    @property
    def complaint(self) -> Complaint | None:
        """The fault that damped the robot for good"""
        return self._supervisor.fault

    @property
    def fault(self) -> str | None:
        """The same in words"""
        return None if self.complaint is None else self.complaint.detail

    def report(self) -> DaemonReport:
        """What was walked, and the fault that ended it."""
        return DaemonReport(
            **asdict(self._walk.report()),
            fault=self.fault,
            fault_name=None if self.complaint is None else str(self.complaint.fault),
            warnings=tuple(self._guard.warnings),
            stuck_walks=self._stop.stuck_walks,
            feet=self.feet.report(),
            refused={str(reason): count for reason, count in self.interface.refused.items()},
        )

    def _orders(self, now: int, mode: Mode, pressed: a1_remote.Remote) -> OperatorCommand:
        """The operator's, unless there is reason to do something else."""
        orders = self.orders = self.operator.orders(now, mode, pressed)
        if complaint := self.operator.complaint:
            self._guard.warn(complaint)
        if orders.request is Request.DAMP:
            self._supervisor.trip(Complaint(Fault.EMERGENCY_STOP, "emergency stop by the operator"))
        if not self.interface.received:
            return orders._replace(request=None)
        if self.stopping or self._remote_lost(now, mode):
            orders = orders._replace(request=Request.SIT)
        stuck = mode is Mode.WALKING and self._stuck()
        return self._stop.orders(now, mode, orders, stuck)

    def _ready(self, now: int, mode: Mode, orders: OperatorCommand) -> OperatorCommand:
        """A robot whose sensors disagree does not stand up, and gives up when they go on."""
        doubt = None
        if mode is Mode.DAMPING and orders.request is Request.STAND and not self.fault:
            doubt = self._guard.sensors.unready(now)
        if doubt is None:
            self._unready_since = None
            return orders
        since = self._unready_since = self._unready_since or now
        if now - since > _REFUSAL_NS:
            told = f" ({self.interface.refusals})" if self.interface.rejected else ""
            self._supervisor.trip(Complaint(Fault.NOT_READY, f"refused to stand up: {doubt}{told}"))
        return orders._replace(request=None)

    def _remote_lost(self, now: int, mode: Mode) -> bool:
        lost = self._watchdog.lost(now, self.interface.state.remote) and self.operator.by_remote
        if lost and mode in (Mode.STANDING_UP, Mode.STANDING, Mode.WALKING):
            self._guard.warn("the remote was lost")
        return lost

    def _stuck(self) -> bool:
        phi, frequency = self.controller.phi, float(self.controller.command[2])
        stuck = self._monitor.stuck(phi, frequency)
        if stuck:
            awaited = self._monitor.awaited(self.controller.state, self.controller.label)
            self._guard.warn(
                f"the gait was stuck: {phi} policy steps without a transition; "
                f"awaited {self.feet.told(awaited)}"
            )
        return stuck

    def _step_policy(self, gravity: np.ndarray, command: tuple[float, float, float]) -> None:
        state, joints = self.interface.state, self._joints
        sensed = PolicyInput(state.q[joints], state.dq[joints], gravity, state.gyro)
        touching, clear = self.controller.contacts(state, gravity)
        for complaint in self.feet.complaints:
            self._guard.warn(complaint)
        if self._stop.under_way:
            touching, clear = self._stop.contacts(self.controller.state)
        self._target[joints] = self.controller.step(touching, clear, sensed, command)
        if complaint := self._action_guard.complaint(self.controller.raw_action, self._target):
            self._supervisor.trip(complaint)


class WalkStatistics:
    """Counts of all policy steps so far, those of a stop left out."""

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

    def report(self) -> WalkReport:
        steps = self._steps
        return WalkReport(
            gait=self._table.gait,
            walking_start_ns=self._start,
            walking_end_ns=self._end,
            policy_steps=steps,
            transitions=self._transitions,
            allowed=self._allowed,
            adherence=self._transitions / self._allowed if steps else None,
            off_spec_contact=self._off_spec / steps if steps else None,
        )
