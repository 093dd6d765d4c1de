"""Which faults the table provokes, and what the daemon should do about each."""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

BEGIN = 2.0
"""[s] of the plan's clock when the fault begins. It is the robot's clock until shortly before,
and then waits until the robot has walked for a second"""


class Reaction(StrEnum):
    DAMPS = "damps"
    SITS = "sits down"
    STANDS = "stands"
    WALKS = "walks on"
    BRAKES = "the board brakes"
    REFUSES = "does not stand up"
    NEVER_WALKED = "did not walk before"
    NOT_JUDGED = "the machine was too busy"


@dataclass(frozen=True)
class FaultRow:
    """One fault."""

    name: str
    what: str
    """In words, for the table"""
    reaction: Reaction
    words: str
    """In the fault or the warning that the daemon reports; empty: it has nothing to report"""
    plan: tuple[dict[str, Any], ...] = ()
    """For the emulator"""
    signals: tuple[tuple[float, str], ...] = ()
    """For the daemon: seconds after BEGIN, name"""
    settings: dict[str, Any] = field(default_factory=dict)
    """Of the daemon's safety section"""
    remote: bool = False
    """The wireless remote leads, instead of flags"""
    answer: float | None = None
    """What a broken policy says from the fault on; None: the policy is in order"""

    @property
    def needs_real_time(self) -> bool:
        """The fault is that the daemon itself is late."""
        return any(name == "SIGSTOP" for _, name in self.signals)


def _fault(name: str, **values: Any) -> dict[str, Any]:
    return {"fault": name, "at": BEGIN, **values}


def _joint(name: str, joint: str = "FR_calf_joint", **values: Any) -> dict[str, Any]:
    return _fault(name, joint=joint, **values)


_PRESSED = (
    {"fault": "remote", "at": 0.0, "seconds": 0.4, "buttons": ["START"]},
    {"fault": "remote", "at": 0.5, "seconds": BEGIN - 0.5, "buttons": ["A"], "ly": 0.4},
)
"""Stands up and walks by the remote; later nobody holds anything"""
_SET_OFF = (_fault("wrong_gyro", rate=[1e3, 0, 0]),)
"""What a broken policy waits for"""
_BELIEVED = {"orientation_error": 1000, "speed_error": 1000}
"""Safety settings with which sensors may contradict each other"""
_HELD_UP = tuple(
    (0.04 * count + after, name)
    for count in range(10)
    for after, name in ((0.0, "SIGSTOP"), (0.025, "SIGCONT"))
)
"""Each time only half as long as the board waits for a command"""
_DAMPS, _WALKS, _SITS = Reaction.DAMPS, Reaction.WALKS, Reaction.SITS
_IMU = ["orientation", "gyroscope", "accelerometer", "rpy"]


def _sensors(fault: str, *names: str) -> tuple[dict[str, Any]]:
    return (_fault(fault, sensors=list(names)),)


def _from_the_start(name: str, **values: Any) -> tuple[dict[str, Any]]:
    return ({"fault": name, "at": 0.0, **values},)


_row = FaultRow

ROWS = (
    _row("pushed_over", "a push of 300 N from the side, until it tips over", _DAMPS, "tilted",
        (_fault("push", seconds=0.5, force=[0, 300, 0]),)),
    _row("flipped_imu", "the orientation of a robot on its back", _DAMPS, "tilted",
        (_fault("flipped_imu"),)),
    _row("small_kick", "the base 0.3 m/s faster sideways, at once", _WALKS, "",
        (_fault("kick", velocity=[0.0, 0.3]),)),
    _row("joint_near_limit", "a hip a little past its mechanical limit", _DAMPS, "limit",
        (_joint("wrong_joint", "FR_hip_joint", q=-0.75),),
        settings={"torque_error": 100, "speed_error": 1000}),
    _row("joint_past_limit", "a calf 1.5 rad from where it is, far past its limit", _DAMPS,
        "past its limit", (_joint("wrong_joint", q=1.5),)),
    _row("joint_speed", "a joint 30 rad/s faster than it is", _DAMPS, "turns at",
        (_joint("wrong_joint", dq=30.0),)),
    _row("power", "1500 W in one joint", _DAMPS, "W", (_joint("wrong_joint", dq=15.0, tau=110.0),)),
    _row("warm_motor", "a motor at 52 °C", _WALKS, "reached 5",
        (_joint("hot_joint", rate=100.0, seconds=0.175),)),
    _row("hot_motor", "a motor that heats up by 100 °C a second", _DAMPS, "°C",
        (_joint("hot_joint", rate=100.0),)),
    _row("silent_board", "no more datagrams from the board", _DAMPS, "no state",
        (_fault("network", direction="from_robot", loss=1.0),)),
    _row("frozen_state", "the same datagram again and again", _DAMPS, "no state",
        (_fault("frozen"),)),
    _row("frozen_values", "the same measurements with a clock that runs", _DAMPS, "not changed",
        (_fault("frozen", clock_runs=True),), settings=_BELIEVED),
    _row("stuck_encoder", "one joint's angle and speed stand still", _DAMPS, "",
        (_joint("stuck_joint"),)),
    _row("nan_joint", "a joint's angle is no number", _DAMPS, "not finite", (_joint("nan_joint"),)),
    _row("corruption", "90 % of the datagrams from the robot damaged", _DAMPS, "broken datagrams",
        (_fault("network", direction="from_robot", corrupt=0.9),), settings={"stale_ms": 1000}),
    _row("some_corruption", "20 % of all datagrams damaged", _WALKS, "",
        (_fault("network", corrupt=0.2),)),
    _row("bad_network", "1 % lost, 1 % doubled, 1 % held back, up to 5 ms late", _WALKS, "",
        (_fault("network", loss=0.01, duplicates=0.01, reorder=0.01, jitter_ms=5),)),
    _row("dead_foot", "a foot sensor reads 0", _WALKS, "", (_fault("dead_foot", foot="FR"),)),
    _row("dead_imu_lying", "an IMU that reads level and 0, before it stands up", Reaction.REFUSES,
        "the accelerometer's mean is 0.00", _from_the_start("dead_imu")),
    _row("swapped_quaternion_lying", "an orientation in the order x, y, z, w, from the start",
        Reaction.REFUSES, "parts in another order?", _from_the_start("swapped_quaternion")),
    _row("no_orientation_lying", "an orientation of 0, 0, 0, 0, from the start", Reaction.REFUSES,
        "no orientation", _from_the_start("dead_sensor", sensors=["orientation"])),
    _row("late_orientation", "the same for the first half second", _WALKS, "",
        _from_the_start("dead_sensor", sensors=["orientation"], seconds=0.5)),
    _row("dead_accelerometer_lying", "an accelerometer that reads 0, from the start",
        Reaction.REFUSES, "the accelerometer's mean is 0.00",
        _from_the_start("dead_sensor", sensors=["accelerometer"])),
    _row("dead_rpy_lying", "roll, pitch and yaw of another orientation, from the start",
        Reaction.REFUSES, "roll, pitch and yaw", _from_the_start("wrong_rpy", rpy=[0.3, 0, 0])),
    _row("dead_speeds_rising", "joint speeds that read 0, from the start", Reaction.DAMPS,
        "joint speeds", _from_the_start("dead_sensor", sensors=["joint_speeds"])),
    _row("dead_imu", "an IMU that reads level and 0", _DAMPS, "the same values",
        (_fault("dead_imu"),)),
    _row("frozen_imu", "all of the IMU stands still, the joints do not", _DAMPS, "orientation",
        _sensors("frozen_sensor", *_IMU)),
    _row("frozen_orientation", "the orientation stands still", _DAMPS, "orientation",
        _sensors("frozen_sensor", "orientation", "rpy")),
    _row("frozen_gyroscope", "the gyroscope stands still", _DAMPS, "gyroscope",
        _sensors("frozen_sensor", "gyroscope")),
    _row("dead_gyroscope", "the gyroscope reads 0", _DAMPS, "gyroscope",
        _sensors("dead_sensor", "gyroscope")),
    _row("frozen_angles", "all joint angles stand still", _DAMPS, "angle",
        _sensors("frozen_sensor", "joint_angles")),
    _row("frozen_speeds", "all joint speeds stand still", _DAMPS, "speed",
        _sensors("frozen_sensor", "joint_speeds")),
    _row("dead_speeds", "all joint speeds read 0", _DAMPS, "speed",
        _sensors("dead_sensor", "joint_speeds")),
    _row("frozen_torques", "all joint torques stand still", _DAMPS, "torque",
        _sensors("frozen_sensor", "joint_torques")),
    _row("swapped_quaternion", "an orientation in the order x, y, z, w", _DAMPS, "orientation",
        (_fault("swapped_quaternion"),)),
    _row("frozen_accelerometer", "the accelerometer stands still", _WALKS, "accelerometer",
        _sensors("frozen_sensor", "accelerometer")),
    _row("dead_accelerometer", "the accelerometer reads 0", _WALKS, "accelerometer",
        _sensors("dead_sensor", "accelerometer")),
    _row("wrong_rpy", "roll, pitch and yaw of another orientation", _WALKS, "roll, pitch and yaw",
        (_fault("wrong_rpy", rpy=[0.3, 0.0, 0.0]),)),
    _row("noisy_feet", "foot sensors that read 18 to 29 whatever the load", _WALKS,
        "foot sensor", (_fault("noisy_feet"),)),
    _row("dead_feet", "all foot sensors read 0", _WALKS, "foot sensor",
        _sensors("dead_sensor", "feet")),
    _row("wild_action", "a gyroscope 10,000 rad/s off: actions out of range", _DAMPS, "action is",
        (_fault("wrong_gyro", rate=[1e4, 0, 0]),), settings=_BELIEVED),
    _row("nan_action", "a policy that answers NaN", _DAMPS, "no finite number",
        _SET_OFF, settings=_BELIEVED, answer=math.nan),
    _row("late_daemon", "the daemon held up for 25 ms, again and again", _DAMPS, "deadlines missed",
        signals=_HELD_UP),
    _row("stuck_gait", "a policy that stops walking", Reaction.STANDS, "gait was stuck",
        _SET_OFF, settings=_BELIEVED, answer=0.0),
    _row("other_commander", "somebody else sends a pose at 500 Hz", _DAMPS, "commander",
        (_fault("other_commander"),)),
    _row("braked_joint", "the board takes a motor out of service, mode 8", _DAMPS, "in mode 0x08",
        (_joint("braked_joint"),)),
    _row("emergency_stop", "L2 and B on the remote", _DAMPS, "emergency stop",
        (*_PRESSED, _fault("remote", seconds=0.1, buttons=["L2", "B"])), remote=True),
    _row("remote_lost", "the remote that leads is gone", _SITS, "remote was lost",
        (*_PRESSED, _fault("remote_lost")), remote=True),
    _row("ctrl_c", "SIGINT", _SITS, "", signals=((0.0, "SIGINT"),)),
    _row("terminated", "SIGTERM", _SITS, "", signals=((0.0, "SIGTERM"),)),
    _row("terminal_closed", "SIGHUP", _SITS, "", signals=((0.0, "SIGHUP"),)),
    _row("impatience", "SIGINT twice", _DAMPS, "", signals=((0.0, "SIGINT"), (0.1, "SIGINT"))),
    _row("killed", "kill -9 of the daemon", Reaction.BRAKES, "", signals=((0.0, "SIGKILL"),)),
)  # fmt: skip
