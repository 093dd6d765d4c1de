"""Why a robot is damped: every fault there is, by name."""

from enum import StrEnum
from typing import NamedTuple


class Fault(StrEnum):
    """What ends in damping, for as long as the program lives."""

    EMERGENCY_STOP = "emergency_stop"
    """By the remote or the operator"""
    ROBOT_REPORTS = "robot_reports"
    """The wire itself knows of something: a silent actuator, an error code"""
    NOT_READY = "not_ready"
    """Sensors of a lying robot that shall stand up disagree"""
    NO_STATE = "no_state"
    BROKEN_DATAGRAMS = "broken_datagrams"
    DEADLINES_MISSED = "deadlines_missed"
    FROZEN_STATE = "frozen_state"
    FROZEN_JOINT = "frozen_joint"
    TILTED = "tilted"
    IMPOSSIBLE_JOINT = "impossible_joint"
    """A measurement that no joint can give"""
    JOINT_LIMIT = "joint_limit"
    JOINT_SPEED = "joint_speed"
    POWER = "power"
    TEMPERATURE = "temperature"
    SENSORS_DISAGREE = "sensors_disagree"
    MOTOR_MODE = "motor_mode"
    MOTOR_TORQUE = "motor_torque"
    """A motor does not do what it was told: another commander?"""
    POLICY_NOT_FINITE = "policy_not_finite"
    POLICY_OUT_OF_RANGE = "policy_out_of_range"

    @property
    def of_any_robot(self) -> bool:
        """Also of one that lies damped, which the others leave as it is."""
        return self in (Fault.EMERGENCY_STOP, Fault.ROBOT_REPORTS, Fault.NOT_READY)


class Complaint(NamedTuple):
    """A fault, and what was seen."""

    fault: Fault
    detail: str
    """One line, for people"""
