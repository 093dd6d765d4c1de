"""The trot on actuators: the daemon, python-can's virtual buses, and the emulator, in lockstep."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from rmll_hil.robot.can_robot import CanRobot
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.runs import lockstep
from rmll_hil.runs.metrics import summary
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.interface.can_interface import CanInterface
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.protocol.can_frame import pack, unpack
from rmll_onboard.settings.can_settings import Bus, Can
from rmll_onboard.settings.runtime_settings import LinkSettings
from rmll_onboard.settings.runtime_settings import RuntimeSettings as DaemonSettings
from rmll_robots import A1

ROOT = Path(__file__).parents[2]
TROT = ROOT / "policies" / "trot.onnx"


def virtual(can: Can) -> Can:
    """The same robot, its buses inside of this process."""
    buses = {name: Bus("virtual", f"test-{name}") for name in can.buses}
    return msgspec.structs.replace(can, buses=buses)


class OnBuses(Emulator):
    """Every frame between daemon and robot goes over a bus."""

    def __init__(self, can: Can, settings: EmulatorSettings) -> None:
        self.actuators = CanRobot(can, A1)
        super().__init__(settings, wire=self.actuators)
        layout = Layout(can, A1)
        self.near = CanTransport(can.buses, layout.answers())
        self.far = CanTransport(can.buses, layout.commands())
        self.silent: set[int] = set()
        """First bytes of the replies that are lost on the first bus"""
        self.fails_at: dict[int, Any] = {}
        """Milliseconds of the robot's clock, and what happens then"""

    def receive(self, datagram: bytes) -> bool:
        self.near.send(datagram)
        return all(super(OnBuses, self).receive(each) for each in self.far.receive())

    def state_datagram(self) -> bytes:
        for moment in [moment for moment in self.fails_at if moment <= self.now_ms]:
            self.fails_at.pop(moment)()
        frames = unpack(super().state_datagram())
        self.far.send(pack(f for f in frames if f.bus or f.id or f.data[0] not in self.silent))
        (datagram,) = self.near.receive()
        return datagram

    def close(self) -> None:
        self.near.close()
        self.far.close()


@pytest.fixture
def can() -> Can:
    return virtual(Can())


@pytest.fixture
def emulator(can: Can) -> Iterator[OnBuses]:
    emulator = OnBuses(can, EmulatorSettings(seed=1))
    yield emulator
    emulator.close()


def walk(emulator: OnBuses, can: Can, seconds: float, vx: float = 0.5) -> Outcome:
    bundle = load_bundle(TROT)
    operator = FlagOperator(bundle.table.commands, vx, seconds=seconds)
    settings = DaemonSettings(link=LinkSettings(kind="can"), can=can)
    return lockstep.walk(emulator, bundle, operator, lambda _: None, settings=settings)


def test_the_trot_walks(emulator: OnBuses, can: Can) -> None:
    outcome = walk(emulator, can, 8.0)
    figures = summary(outcome, "trot", A1)
    assert figures.fault is None
    assert figures.falls == 0
    assert figures.adherence >= 0.9
    assert figures.vx_error <= 0.15
    assert outcome.report.packets.lost == 0
    assert agreement(outcome) >= 0.8


def agreement(outcome: Outcome) -> float:
    """Share of feet and policy steps whose contact is what the daemon took it for."""
    rows = [row for row in outcome.log if row.mode == "walking"]
    seen = np.array(
        [[getattr(row, f"down_{foot}") for foot in A1.foot_names] for row in rows], bool
    )
    moments = np.array([row.t_ns for row in rows])
    truth = outcome.truth[np.searchsorted(outcome.truth["time_ns"], moments)]
    return float((seen == truth["contact"]).mean())


def test_an_actuator_that_falls_silent_damps_the_robot(emulator: OnBuses, can: Can) -> None:
    emulator.fails_at[6000] = lambda: emulator.silent.add(2)
    outcome = walk(emulator, can, 8.0)
    assert outcome.report.fault == "actuator FR_thigh_joint has been silent for more than 50 ms"
    assert damped_after(outcome, 6000) <= 75
    assert_damped(emulator)
    # the farewell is long enough for the robot to sink; only then do the actuators go limp
    end = outcome.truth["time_ns"] >= (6.1 + CanInterface.farewell) * 1e9
    assert outcome.truth["position"][end, 2].max() < 0.15


def test_an_actuators_error_damps_the_robot(emulator: OnBuses, can: Can) -> None:
    def fail() -> None:
        emulator.actuators.errors[5] = 2

    emulator.fails_at[6000] = fail
    outcome = walk(emulator, can, 8.0)
    assert outcome.report.fault == "actuator FL_calf_joint reports error 2: over-current"
    assert damped_after(outcome, 6000) <= 25
    assert_damped(emulator)


def damped_after(outcome: Outcome, failure_ms: int) -> float:
    """[ms] from a failure to the first row of the log that is damped; the log has 50 Hz."""
    walking = [row for row in outcome.log if row.mode == "walking"]
    return walking[-1].t_ns / 1e6 + 20 - failure_ms


def assert_damped(emulator: OnBuses) -> None:
    told = emulator.actuators._command()
    assert not told.kp.any()
    np.testing.assert_allclose(told.kd, A1.damping_kd)
    assert emulator.world.data.qpos[2] < 0.2
