"""Do the sensor checks alarm without a reason? Hours of walking with sensors that are in order.

    python tests/benchmarks/bench_false_alarms.py --out false-alarms.jsonl --hours 20 --engine both

Every policy of ``policies/``, flat and rough ground, pushes, commands that change, sensor noise as
the emulator has it, the wire of an A1 and CAN's in turn. An interrupted run goes on where it was.

``emulator`` walks the whole daemon in lockstep. ``trainer`` has many robots at once, in the
trainer's physics, each with a monitor of its own that sees 200 states a second. A line of the file
is a walk: its hours, its alarms, and the largest that each check ever saw.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
import tyro

from rmll_hil.robot.can_robot import CanRobot
from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.emulator import EmulatorSettings as EmulatorSettings
from rmll_hil.robot.fault_plan import parse_plan
from rmll_hil.robot.sensors import Noise, roll_pitch_yaw
from rmll_hil.runs import lockstep
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.protocol.a1_remote import Remote
from rmll_onboard.safety.sensor_monitor import IN_A_WALK, SensorMonitor
from rmll_onboard.settings.runtime_settings import RuntimeSettings
from rmll_onboard.state.modes import NS, Mode, Request
from rmll_onboard.state.robot_state import RobotState, Streams
from rmll_robots import A1

Engine = Literal["emulator", "trainer", "both"]
POLICIES = sorted((Path(__file__).parents[2] / "policies").glob("*.onnx"))
SAFETY = RuntimeSettings().safety
LIMITS = {
    "orientation_error": SAFETY.orientation_error,
    "speed_error": SAFETY.speed_error,
    "rpy_error": SAFETY.rpy_error,
    "gravity_error": IN_A_WALK * SAFETY.gravity_error,
    "same_ms": SAFETY.frozen_ms,
    "still_ms": SAFETY.joint_still_ms,
}
EMULATED, TRAINED = 60.0, 100.0
"""[s] of a walk, in either engine"""
ROBOTS = 48
"""of the trainer's world"""
FORGOTTEN = 4000
"""[ms]"""
NOISE = Noise()


@dataclass
class Extremes:
    """The largest that each check saw, and what it said."""

    worst: list[float] = field(default_factory=lambda: [0.0] * len(LIMITS))
    """In the order of LIMITS"""
    alarms: set[str] = field(default_factory=set)

    def see(self, monitor: SensorMonitor, now: int) -> None:
        attitude, joints = monitor.attitude, monitor.joints
        values = (
            attitude.drift,
            joints.drift,
            attitude.rpy_error,
            attitude.gravity_error,
            (now - min(monitor.values._changed)) / 1e6,
            joints.still_ms,
        )
        self.worst = list(map(max, self.worst, values))
        if told := monitor.fault or monitor.doubt:
            self.alarms.add(str(told))


class Wanderer:
    """An operator who wants something else every three seconds."""

    by_remote = False
    complaint = None

    def __init__(self, ranges: Any, seconds: float, seed: int) -> None:
        self._ranges, self._seconds = ranges, seconds
        self._random = np.random.default_rng(seed)
        self._began: int | None = None
        self._until = 0
        self._command = 0.0, 0.0, ranges.frequency[0]

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        if mode is Mode.WALKING and self._began is None:
            self._began = now
        if now >= self._until:
            ranges = self._ranges
            vx, wz, frequency = (
                float(self._random.uniform(*limits))
                for limits in (ranges.vx, ranges.wz, ranges.frequency)
            )
            self._command, self._until = (vx, wz, frequency), now + 3 * NS
        if self._began is None:
            wish = {Mode.DAMPING: Request.STAND, Mode.STANDING: Request.WALK}.get(mode)
        else:
            wish = Request.SIT if now - self._began > self._seconds * NS else None
        return OperatorCommand(wish, self._command)

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return fault is not None or (self._began is not None and mode is Mode.DAMPING)


def emulated(number: int) -> dict[str, Any]:
    """One robot, its whole daemon."""
    policy, rough, can = POLICIES[number % 8], number // 8 % 2, number // 16 % 2
    random = np.random.default_rng(number)
    bundle = load_bundle(policy)
    settings = RuntimeSettings().over("can" if can else "udp")
    kicks = [
        {"fault": "kick", "at": float(at), "velocity": random.uniform(-0.7, 0.7, 2).tolist()}
        for at in np.arange(6.0, EMULATED, 4.0)
    ]
    emulator = Emulator(
        EmulatorSettings(seed=number, ground="rough" if rough else "flat"),
        robot=bundle.robot,
        plan=parse_plan(kicks, bundle.robot),
        wire=CanRobot(settings.can, bundle.robot) if can else None,
    )
    extremes = Extremes()
    measure = SensorMonitor.measure

    def watched(monitor: SensorMonitor, now: int, *state: Any) -> None:
        measure(monitor, now, *state)
        if state[1]:
            extremes.see(monitor, now)

    SensorMonitor.measure = watched
    try:
        operator = Wanderer(bundle.table.commands, EMULATED, number)
        outcome = lockstep.walk(emulator, bundle, operator, lambda _: None, settings=settings)
    finally:
        SensorMonitor.measure = measure
    report = outcome.report
    return {
        "gait": policy.stem,
        "ground": "rough" if rough else "flat",
        "wire": "can" if can else "a1",
        "seconds": emulator.now_ms / 1000,
        "alarms": sorted(extremes.alarms),
        "fault": report.fault,
        "warnings": report.warnings,
        "worst": dict(zip(LIMITS, extremes.worst, strict=True)),
    }


class Robots:
    """Monitors beside a trainer's simulation, which they see at each of its physics steps."""

    def __init__(self, simulation: Any, seed: int) -> None:
        self.extremes = Extremes()
        self._simulation = simulation
        self._random = np.random.default_rng(seed)
        self._layout = Layout(RuntimeSettings().can, A1)
        self._acc = slice(*_where(simulation._model, "imu_acc"))
        n = simulation.num
        self._bias = self._random.normal(0, NOISE.gyro_bias, (n, 3))
        self._states = [RobotState() for _ in range(n)]
        self._now = 0
        self._monitors = [self._monitor(robot) for robot in range(n)]
        self._began, self._fast_at = np.zeros(n), np.full(n, -1e9)
        self._fastest = 1.4 * A1.velocity_limit

    def begin(self, robots: list[int]) -> None:
        """These were put somewhere else."""
        for robot in robots:
            self._monitors[robot] = self._monitor(robot)
            self._began[robot] = self._now

    def see(self) -> None:
        """A physics step is over."""
        self._now += 5
        simulation, random, noise = self._simulation, self._random, NOISE
        pose, twist = simulation._qpos, simulation._qvel
        n, normal = len(pose), random.normal
        q = pose[:, 7:] + normal(0, noise.joint_position, (n, 12))
        dq = twist[:, 6:] + normal(0, noise.joint_velocity, (n, 12))
        tau = simulation._force + normal(0, noise.joint_torque, (n, 12))
        gyro = twist[:, 3:6] + self._bias + normal(0, noise.gyro, (n, 3))
        felt = simulation._sensor[:, self._acc] + normal(0, noise.accelerometer, (n, 3))
        quaternion = _turned(pose[:, 3:7], normal(0, noise.attitude, (n, 3)))
        rpy = np.array(roll_pitch_yaw(quaternion.T)).T
        self._over_can(q, dq, tau, quaternion, gyro)
        too_fast = np.abs(twist[:, 6:]).max(1) > self._fastest
        self._fast_at[too_fast] = self._now
        for robot, (state, monitor) in enumerate(zip(self._states, self._monitors, strict=True)):
            state.q, state.dq, state.tau = q[robot], dq[robot], tau[robot]
            state.quaternion, state.gyro = quaternion[robot], gyro[robot]
            state.accelerometer, state.rpy, state.tick = felt[robot], rpy[robot], self._now
            monitor.measure(self._now * 1_000_000, state, True, True)
            # here a robot begins in the air, which the mean of the accelerometer still knows, and
            # its motors have no limit of speed, where the daemon would have damped it
            if self._now - max(self._began[robot], self._fast_at[robot]) > FORGOTTEN:
                self.extremes.see(monitor, self._now * 1_000_000)

    def _over_can(self, q: Any, dq: Any, tau: Any, quaternion: Any, gyro: Any) -> None:
        """What CAN makes of every second robot's state, in place."""
        layout, odd = self._layout, slice(1, None, 2)
        ranges = layout.ranges
        q[odd] = layout.to_joint(_in_steps(layout.to_actuator(q[odd]), ranges.position, 16))
        dq[odd] = _in_steps(dq[odd], ranges.velocity, 12)
        tau[odd] = _in_steps(tau[odd], ranges.torque, 12)
        quaternion[odd] = np.rint(quaternion[odd] * 32767) / 32767
        gyro[odd] = np.rint(gyro[odd] * 900) / 900

    def _monitor(self, robot: int) -> SensorMonitor:
        monitor = SensorMonitor(A1, SAFETY, Streams(*[robot % 2 == 0] * 2), 1e-3)
        monitor.values._changed[:] = [self._now * 1_000_000] * len(monitor.values._changed)
        return monitor


def _in_steps(values: np.ndarray, end: np.ndarray, bits: int) -> np.ndarray:
    """Rounded to the nearest of 2^bits values from -end to end."""
    top = 2**bits - 1
    share = (values / end).clip(-1, 1) * 0.5 + 0.5
    return (np.rint(share * top) / top * 2 - 1) * end


def trained(number: int) -> dict[str, Any]:
    """Many robots in the trainer's world."""
    import torch

    from rmll_eval.trained import _world, actor
    from rmll_train.env.environment import GaitEnv
    from rmll_train.train_settings import GroundSettings

    torch.set_num_threads(1)
    policy, rough = POLICIES[number % 8], number // 8 % 2
    bundle = load_bundle(policy)
    world = _world(bundle)
    pushed = replace(world.randomisation, push_interval=4.0, push_velocity=0.7)
    ground = GroundSettings(kinds=("rough",)) if rough else GroundSettings()
    world = replace(
        world, envs=ROBOTS, randomisation=pushed, ground=ground, command_interval=3.0, episode=1e4
    )
    env = GaitEnv(bundle.table, bundle.robot, world, number)
    env.demands.progress = 1.0
    act, simulation = actor(policy), env.simulation
    robots = Robots(simulation, number)
    batch, step = simulation._batch, simulation._batch.step

    def watched(nstep: int) -> None:
        for _ in range(nstep):
            step(nstep=1)
            robots.see()

    simulation._batch = _Stepped(batch, watched)
    steps = round(TRAINED * bundle.robot.policy_hz)
    falls = 0
    with torch.no_grad():
        for _ in range(steps):
            _, _, done, _ = env.step(act(env.get_observations()))
            if done.any():
                robots.begin(done.nonzero()[:, 0].tolist())
                falls += int(done.sum())
    return {
        "gait": policy.stem,
        "ground": "rough" if rough else "flat",
        "wire": "a1 and can",
        "seconds": TRAINED * ROBOTS,
        "ends": falls,
        "alarms": sorted(robots.extremes.alarms),
        "worst": dict(zip(LIMITS, robots.extremes.worst, strict=True)),
    }


class _Stepped:
    """A batch whose steps are taken one by one."""

    def __init__(self, batch: Any, step: Any) -> None:
        self._batch, self.step = batch, step

    def __getattr__(self, name: str) -> Any:
        return getattr(self._batch, name)


def _turned(quaternion: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """(n, 4) after small turns (n, 3) [rad] about the body's axes."""
    half = np.concatenate([np.ones((len(angles), 1)), angles / 2], axis=1)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    w, x, y, z = quaternion.T
    a, b, c, d = half.T
    return np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=1,
    )


def _where(model: Any, sensor: str) -> tuple[int, int]:
    first = int(model.sensor(sensor).adr[0])
    return first, first + 3


def main(out: Path, hours: float = 20.0, engine: Engine = "both") -> None:
    """Walk until the file has so many hours of each engine asked for, then tell the margins."""
    engines = ("emulator", "trainer") if engine == "both" else (engine,)
    for name in engines:
        walk = emulated if name == "emulator" else trained
        for number in count():
            rows = list(_rows(out, name))
            if sum(row["seconds"] for row in rows) >= hours * 3600:
                break
            if number in {row["number"] for row in rows}:
                continue
            began = perf_counter()
            row = {"engine": name, "number": number} | walk(number)
            row["factor"] = round(row["seconds"] / (perf_counter() - began), 2)
            with out.open("a") as file:
                file.write(json.dumps(row) + "\n")
        tell(name, list(_rows(out, name)))


def tell(engine: str, rows: list[dict[str, Any]]) -> None:
    hours = sum(row["seconds"] for row in rows) / 3600
    alarms = [alarm for row in rows for alarm in row["alarms"]]
    print(f"{engine}: {hours:.1f} h in {len(rows)} walks, {len(alarms)} alarms {alarms[:3]}")
    for name, limit in LIMITS.items():
        worst = max(row["worst"][name] for row in rows)
        margin = limit / max(worst, 1e-9)
        print(f"  {name:18} limit {limit:6.2f}  largest {worst:8.4f}  margin {margin:6.1f}")


def _rows(out: Path, engine: str) -> Iterator[dict[str, Any]]:
    if out.exists():
        for line in out.read_text().splitlines():
            row = json.loads(line)
            if row["engine"] == engine:
                yield row


if __name__ == "__main__":
    tyro.cli(main)
