"""Sensors that fail over CAN; over the A1's wire they are rows of the fault table."""

from pathlib import Path

import numpy as np
import pytest

from rmll_hil.robot.can_robot import CanRobot
from rmll_hil.robot.emulator import Emulator
from rmll_hil.robot.fault_plan import parse_plan
from rmll_hil.runs import lockstep
from rmll_hil.runs.outcome import Outcome
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.settings.runtime_settings import Motion, RuntimeSettings
from rmll_robots import A1

TROT = Path(__file__).parents[2] / "policies" / "trot.onnx"
AT = 2.5
"""[s] when a fault begins; the robot walks then"""
BRISK = Motion(crouch=0.3, rise=0.6, settle=0.2, slow_down=0.3, sit=0.3)


def walk(*plan: dict) -> Outcome:
    bundle = load_bundle(TROT)
    settings = RuntimeSettings(motion=BRISK).over("can")
    robot = CanRobot(settings.can, bundle.robot)
    emulator = Emulator(robot=bundle.robot, plan=parse_plan(list(plan), A1), wire=robot)
    operator = FlagOperator(bundle.table.commands, vx=0.4, seconds=2.0)
    return lockstep.walk(emulator, bundle, operator, lambda _: None, settings=settings)


def sensors(fault: str, *names: str) -> dict:
    return {"fault": fault, "at": AT, "sensors": list(names)}


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (sensors("frozen_sensor", "gyroscope"), "gyroscope"),
        (sensors("frozen_sensor", "orientation"), "orientation"),
        (sensors("frozen_sensor", "orientation", "gyroscope"), "orientation"),
        (sensors("dead_sensor", "gyroscope"), "gyroscope"),
        (sensors("dead_sensor", "joint_speeds"), "speed"),
        (sensors("frozen_sensor", "joint_torques"), "torque"),
        ({"fault": "dead_imu", "at": AT}, "orientation"),
        ({"fault": "swapped_quaternion", "at": AT}, "orientation"),
    ],
)
def test_over_can_it_damps_within_two_tenths_of_a_second(fault: dict, words: str) -> None:
    outcome = walk(fault)
    assert words in (outcome.report.fault or "no fault")
    # the daemon ends with its fault
    assert outcome.log[-1].t_ns / 1e9 - AT < 0.2


def test_over_can_sensors_in_order_are_believed() -> None:
    outcome = walk()
    assert (outcome.report.fault, outcome.report.warnings) == (None, ())


def test_over_can_without_an_orientation_it_does_not_stand_up() -> None:
    outcome = walk({"fault": "dead_sensor", "sensors": ["orientation"]})
    assert outcome.report.fault == (
        "refused to stand up: no orientation: its quaternion has the length 0.00"
    )
    assert np.ptp(outcome.truth["position"][:, 2]) < 0.01
