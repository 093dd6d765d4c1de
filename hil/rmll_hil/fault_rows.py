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
    NEVER_WALKED = "did not walk before"
    NOT_JUDGED = "the machine was too busy"


@dataclass(frozen=True)
class Row:
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
    def is_about_time(self) -> bool:
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
_HELD_UP = tuple(
    (0.04 * count + after, name)
    for count in range(10)
    for after, name in ((0.0, "SIGSTOP"), (0.025, "SIGCONT"))
)
"""Each time only half as long as the board waits for a command"""
_DAMPS, _WALKS, _SITS = Reaction.DAMPS, Reaction.WALKS, Reaction.SITS

ROWS = (
    Row("pushed_over", "a push of 300 N from the side, until it tips over", _DAMPS, "tilted",
        (_fault("push", seconds=0.5, force=[0, 300, 0]),)),
    Row("flipped_imu", "the orientation of a robot on its back", _DAMPS, "tilted",
        (_fault("flipped_imu"),)),
    Row("small_kick", "the base 0.3 m/s faster sideways, at once", _WALKS, "",
        (_fault("kick", velocity=[0.0, 0.3]),)),
    Row("joint_near_limit", "a hip a little past its mechanical limit", _DAMPS, "limit",
        (_joint("wrong_joint", "FR_hip_joint", q=-0.75),), settings={"torque_error": 100}),
    Row("joint_past_limit", "a calf 1.5 rad from where it is, far past its limit", _DAMPS,
        "past its limit", (_joint("wrong_joint", q=1.5),)),
    Row("joint_speed", "a joint 30 rad/s faster than it is", _DAMPS, "turns at",
        (_joint("wrong_joint", dq=30.0),)),
    Row("power", "1500 W in one joint", _DAMPS, "W", (_joint("wrong_joint", dq=15.0, tau=110.0),)),
    Row("warm_motor", "a motor at 52 °C", _WALKS, "reached 5",
        (_joint("hot_joint", rate=100.0, seconds=0.175),)),
    Row("hot_motor", "a motor that heats up by 100 °C a second", _DAMPS, "°C",
        (_joint("hot_joint", rate=100.0),)),
    Row("silent_board", "no more datagrams from the board", _DAMPS, "no state",
        (_fault("network", direction="from_robot", loss=1.0),)),
    Row("frozen_state", "the same datagram again and again", _DAMPS, "no state",
        (_fault("frozen"),)),
    Row("frozen_values", "the same measurements with a clock that runs", _DAMPS, "not changed",
        (_fault("frozen", clock_runs=True),)),
    Row("stuck_encoder", "one joint's angle and speed stand still", _DAMPS, "",
        (_joint("stuck_joint"),)),
    Row("nan_joint", "a joint's angle is no number", _DAMPS, "not finite", (_joint("nan_joint"),)),
    Row("corruption", "90 % of the datagrams from the robot damaged", _DAMPS, "broken datagrams",
        (_fault("network", direction="from_robot", corrupt=0.9),), settings={"stale_ms": 1000}),
    Row("some_corruption", "20 % of all datagrams damaged", _WALKS, "",
        (_fault("network", corrupt=0.2),)),
    Row("bad_network", "1 % lost, 1 % doubled, 1 % held back, up to 5 ms late", _WALKS, "",
        (_fault("network", loss=0.01, duplicates=0.01, reorder=0.01, jitter_ms=5),)),
    Row("dead_foot", "a foot sensor reads 0", _WALKS, "", (_fault("dead_foot", foot="FR"),)),
    Row("wild_action", "a gyroscope 10,000 rad/s off: actions out of range", _DAMPS, "action is",
        (_fault("wrong_gyro", rate=[1e4, 0, 0]),)),
    Row("nan_action", "a policy that answers NaN", _DAMPS, "no finite number",
        _SET_OFF, answer=math.nan),
    Row("late_daemon", "the daemon held up for 25 ms, again and again", _DAMPS, "deadlines missed",
        signals=_HELD_UP),
    Row("stuck_gait", "a policy that stops walking", Reaction.STANDS, "gait was stuck",
        _SET_OFF, answer=0.0),
    Row("other_commander", "somebody else sends a pose at 500 Hz", _DAMPS, "commander",
        (_fault("other_commander"),)),
    Row("braked_joint", "the board takes a motor out of service, mode 8", _DAMPS, "in mode 0x08",
        (_joint("braked_joint"),)),
    Row("emergency_stop", "L2 and B on the remote", _DAMPS, "emergency stop",
        (*_PRESSED, _fault("remote", seconds=0.1, buttons=["L2", "B"])), remote=True),
    Row("remote_lost", "the remote that leads is gone", _SITS, "remote was lost",
        (*_PRESSED, _fault("remote_lost")), remote=True),
    Row("ctrl_c", "SIGINT", _SITS, "", signals=((0.0, "SIGINT"),)),
    Row("terminated", "SIGTERM", _SITS, "", signals=((0.0, "SIGTERM"),)),
    Row("terminal_closed", "SIGHUP", _SITS, "", signals=((0.0, "SIGHUP"),)),
    Row("impatience", "SIGINT twice", _DAMPS, "", signals=((0.0, "SIGINT"), (0.1, "SIGINT"))),
    Row("killed", "kill -9 of the daemon", Reaction.BRAKES, "", signals=((0.0, "SIGKILL"),)),
)  # fmt: skip
