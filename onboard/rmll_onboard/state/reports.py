"""What a run leaves to be read: by people, by ``rmll-hil`` and by whoever takes the JSON.

The order of the fields is that of the JSON that ``rmll-onboard --json`` prints, which is flat:
:class:`RunReport` has the fields of all the parts' reports.
"""

from typing import Literal

import msgspec
from msgspec.structs import asdict


class UpperPercentiles(msgspec.Struct, frozen=True):
    """[us]; so much is not exceeded by half, 99 %, 99.9 % and all of the durations."""

    p50: float
    p99: float
    p999: float
    max: float


class LowerPercentiles(msgspec.Struct, frozen=True):
    """[us]; so much is not exceeded by half, 1 %, 0.1 % and the least of the durations."""

    p50: float
    p01: float
    p001: float
    min: float


class WalkReport(msgspec.Struct, frozen=True):
    """Counts of all policy steps, those of a stop left out; None where nothing was walked."""

    gait: str
    walking_start_ns: int | None
    """Monotonic, and so is the end"""
    walking_end_ns: int | None
    policy_steps: int
    transitions: int
    """Made by the automaton"""
    allowed: float
    """Transitions for which the ordered frequencies left time"""
    adherence: float | None
    """Transitions made over those allowed"""
    off_spec_contact: float | None
    """Share of policy steps whose label the automaton cannot explain"""


class FeetReport(msgspec.Struct, frozen=True):
    """What was known of the feet at the end. Tuples have an entry a foot, FR, FL, RR, RL."""

    contact_by: tuple[Literal["sensor", "torque"], ...]
    gain: tuple[float | None, ...]
    """[raw/N] that was learnt; None for a sensor that is not believed, empty without sensors"""
    bias: tuple[float | None, ...]
    """[raw]"""
    doubts: dict[str, str]
    """Feet whose sensor is doubted, and why"""


class DaemonReport(WalkReport, frozen=True):
    """The walk, and what happened to the robot in it."""

    fault: str | None
    """What ended it in damping, in words"""
    fault_name: str | None
    """The same as one of :class:`rmll_onboard.safety.faults.Fault`"""
    warnings: tuple[str, ...]
    stuck_walks: int
    """How often the gait waited so long for a contact that the robot stopped by itself"""
    feet: FeetReport
    refused: dict[str, int]
    """Reasons for which datagrams were not believed, and how many for each"""


class Timekeeping(msgspec.Struct, frozen=True):
    """How well the loop kept its time, in detail."""

    plain_tick_us: UpperPercentiles | None
    """A tick without the policy"""
    slack_us: LowerPercentiles | None
    """What is left of a period when everything is done; negative if it was too short"""
    missed: int
    """Deadlines that were left out because a tick ended after them"""
    memory_mb: tuple[float, ...]
    """Resident, once a minute and at the end"""


class TimingReport(msgspec.Struct, frozen=True):
    """None where nothing was measured, as in lockstep, which has no real time."""

    tick_us: UpperPercentiles | None
    """A policy tick, from the receive call to the return of the send call"""
    wake_us: UpperPercentiles | None
    """Lateness of a wake-up against its deadline"""
    rss_mb: float | None
    """Peak of the resident memory"""
    timekeeping: Timekeeping | None


class PacketReport(msgspec.Struct, frozen=True):
    """Counts of datagrams."""

    sent: int
    received: int
    """States that were accepted"""
    rejected: int
    lost: int
    """Ticks without a new state, after the first one"""


class LoopReport(TimingReport, frozen=True):
    """How well time was kept, and what went over the link."""

    packets: PacketReport


class RecordingResult(msgspec.Struct, frozen=True):
    """What the recording process says when it ends."""

    ticks: int | None
    """Written; None if it cannot be known"""
    megabytes: float | None
    """On the disk"""
    trouble: str | None
    """What went wrong"""


class RecordingReport(msgspec.Struct, frozen=True):
    """That, and what is known on this side of the pipe."""

    file: str
    dropped: int
    """Ticks that could not be handed over"""
    ticks: int | None
    megabytes: float | None
    trouble: str | None


class RunReport(DaemonReport, frozen=True):
    """All there is to report of a run: the fields of a DaemonReport and of a LoopReport."""

    tick_us: UpperPercentiles | None
    wake_us: UpperPercentiles | None
    rss_mb: float | None
    timekeeping: Timekeeping | None
    packets: PacketReport
    record: RecordingReport | None
    """None if nothing was recorded"""

    @classmethod
    def of(
        cls, daemon: DaemonReport, loop: LoopReport, record: RecordingReport | None
    ) -> "RunReport":
        """The parts as one."""
        return cls(**asdict(daemon), **asdict(loop), record=record)
