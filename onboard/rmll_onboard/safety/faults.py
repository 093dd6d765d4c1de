"""Why a robot is damped: every fault there is, by name."""

from enum import StrEnum
from typing import NamedTuple


class Fault(StrEnum):
    """What ends in damping, for as long as the program lives."""

    meaning: str
    """In words"""

    def __new__(cls, name: str, meaning: str) -> "Fault":
        fault = str.__new__(cls, name)
        fault._value_ = name
        fault.meaning = meaning
        return fault

    EMERGENCY_STOP = "emergency_stop", "by the remote or the operator"
    ROBOT_REPORTS = "robot_reports", "the wire itself tells: a silent actuator, an error code"
    NOT_READY = "not_ready", "sensors of a lying robot that shall stand up disagree"
    NO_STATE = "no_state", "no new state from the robot"
    BROKEN_DATAGRAMS = "broken_datagrams", "too many ticks bring broken datagrams only"
    DEADLINES_MISSED = "deadlines_missed", "the daemon is late"
    FROZEN_STATE = "frozen_state", "new states with the same measurements"
    FROZEN_JOINT = "frozen_joint", "a joint of a walking robot that always reads the same"
    TILTED = "tilted", "roll or pitch beyond its limit, or no orientation"
    IMPOSSIBLE_JOINT = "impossible_joint", "a measurement that no joint can give"
    JOINT_LIMIT = "joint_limit", "a walking robot's joint at its mechanical limit"
    JOINT_SPEED = "joint_speed", "a joint that turns too fast"
    POWER = "power", "the motors take too much power"
    TEMPERATURE = "temperature", "a motor is too hot"
    SENSORS_DISAGREE = "sensors_disagree", "what policy or guard need cannot be believed"
    MOTOR_MODE = "motor_mode", "a motor is in another mode than it was told"
    MOTOR_TORQUE = "motor_torque", "a motor's torque is not what was commanded"
    POLICY_NOT_FINITE = "policy_not_finite", "the policy answers no finite number"
    POLICY_OUT_OF_RANGE = "policy_out_of_range", "the policy's action is far out of its range"

    @property
    def of_any_robot(self) -> bool:
        """Also of one that lies damped, which the others leave as it is."""
        return self in (Fault.EMERGENCY_STOP, Fault.ROBOT_REPORTS, Fault.NOT_READY)

    @property
    def of_walks_only(self) -> bool:
        """There is nothing to check in a robot that does not walk."""
        return self in (
            Fault.FROZEN_JOINT,
            Fault.JOINT_LIMIT,
            Fault.POLICY_NOT_FINITE,
            Fault.POLICY_OUT_OF_RANGE,
        )


class Complaint(NamedTuple):
    """A fault, and what was seen."""

    fault: Fault
    detail: str
    """One line, for people"""
