"""A recorded walk through today's daemon: the same datagrams in, are they the same out?"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rmll_common.errors import InputError
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.protocol.a1_packets import LOW_CMD, SLOTS
from rmll_onboard.protocol.a1_remote import Remote
from rmll_onboard.recording.flight_log import FlightLog, Gap
from rmll_onboard.recording.log_metadata import versions
from rmll_onboard.recording.telemetry import Tick
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.state.modes import NS, Mode
from rmll_onboard.state.robot_state import JOINTS


class RecordedOperator:
    """Wants at each tick what was wanted then."""

    complaint = None

    def __init__(self) -> None:
        self.wanted = OperatorCommand(None, (0.0, 0.0, 0.0))
        self.by_remote = False

    def orders(self, now: int, mode: Mode, remote: Remote) -> OperatorCommand:
        return self.wanted

    def finished(self, mode: Mode, fault: str | None) -> bool:
        return False


@dataclass(frozen=True)
class ReplayedField:
    """A field of a datagram that is not what it was."""

    name: str
    recorded: str
    replayed: str


@dataclass(frozen=True)
class Difference:
    """The first datagram that is not what it was."""

    tick: int
    seconds: float
    """Since the log's beginning"""
    mode: str
    """Of today's daemon"""
    fields: list[ReplayedField]


@dataclass
class Replay:
    """How a replay went."""

    ticks: int = 0
    seconds: float = 0.0
    different: int = 0
    """Datagrams that are not what they were"""
    first: Difference | None = None
    largest: float = 0.0
    """[rad] of differing targets; infinite if anything else differs"""
    missing: int | None = None
    """Tick that the log lacks: there the replay ends"""
    not_compared: int = 0
    """Ticks after it. What the daemon had come to by then is not known"""
    gaps: list[Gap] = field(default_factory=list)
    lost: int | None = None
    """Messages that were damaged; None if the log does not tell"""
    complete: bool = True
    """The log has its proper end, it was not cut short"""
    remarks: list[str] = field(default_factory=list)
    """What is not as it was when it was recorded"""

    @property
    def identical(self) -> bool:
        return self.different == 0 and self.missing is None


def replay(log: FlightLog, bundle: Bundle, progress: Callable[[int], None]) -> Replay:
    """Run ``log`` through a daemon of today; ``progress`` hears of each tick.

    Raises InputError for a log that is damaged or holds no tick.
    """
    operator = RecordedOperator()
    daemon = Daemon(bundle, log.about.daemon_settings(), operator)
    found = Replay(remarks=_remarks(log, bundle))
    began = None
    for tick in log.ticks():
        if found.missing is None and tick.number != found.ticks:
            found.missing = found.ticks
        if found.missing is not None:
            found.not_compared += 1
            continue
        began = tick.now if began is None else began
        operator.wanted = OperatorCommand(tick.request, tick.command)
        operator.by_remote = tick.by_remote
        daemon.stopping = tick.stopping
        answer = daemon.tick(tick.now, tick.datagrams)
        found.ticks += 1
        found.seconds = (tick.now - began) / NS
        if answer != tick.answer:
            _differs(found, tick, answer, daemon.mode, bundle.robot.joint_names)
        progress(found.ticks)
    found.complete, found.gaps, found.lost = log.complete, log.gaps, log.lost
    if found.missing is None and log.gaps:  # nothing follows it
        found.missing = log.gaps[0].first
    if began is None and found.missing is None:
        raise InputError(f"{log.source}: no tick in it")
    return found


def find_bundle(log: FlightLog, policies: Path) -> Path:
    """The gait's shipped bundle, if it is the one that the log was recorded with.

    Raises InputError if it is another one, or if there is none: a bundle of the same name does not
    stand in for that of the walk.
    """
    about = log.about
    path = policies / f"{about.gait}.onnx"
    if not path.is_file():
        raise InputError(f"{path}: no such bundle; name the one to replay with by --policy")
    bundle = load_bundle(path)
    if bundle.contract.digest != about.digest:
        rules = about.machine_table().rules == bundle.table.rules
        raise InputError(
            f"{log.source}: recorded with {about.policy} {about.digest[:12]}, but {path} is "
            f"{bundle.contract.digest[:12]}, of {'the same' if rules else 'other'} rules; "
            "name the one to replay with by --policy"
        )
    return path


def _differs(found: Replay, tick: Tick, answer: bytes, mode: Mode, joints: Sequence[str]) -> None:
    found.different += 1
    if found.first is None:
        fields = list(differences(tick.answer, answer, joints))
        found.first = Difference(tick.number, found.seconds, mode, fields)
    found.largest = max(found.largest, _target_distance(tick.answer, answer))


def differences(recorded: bytes, replayed: bytes, joints: Sequence[str]) -> Iterator[ReplayedField]:
    """Field by field, what differs in two LowCmd datagrams; byte by byte in any others.

    ``joints`` are in the wire's order.
    """
    if len(recorded) != len(replayed):
        yield ReplayedField("length", str(len(recorded)), str(len(replayed)))
    if len(recorded) != LOW_CMD.itemsize or len(replayed) != LOW_CMD.itemsize:
        for position, (old, new) in enumerate(zip(recorded, replayed, strict=False)):
            if old != new:
                yield ReplayedField(f"byte {position}", f"{old:#04x}", f"{new:#04x}")
        return
    then, now = (_flat(np.frombuffer(data, LOW_CMD)[0], joints) for data in (recorded, replayed))
    for name in then:
        # compared as bytes, for NaN differs from itself
        if then[name].tobytes() != now[name].tobytes():
            yield ReplayedField(name, str(then[name]), str(now[name]))


def _flat(packet: np.void, joints: Sequence[str]) -> dict[str, np.ndarray]:
    motors = [*joints, *(f"motor[{slot}]" for slot in range(len(joints), SLOTS))]
    fields = {
        f"{motor}.{name}": slot[name]
        for motor, slot in zip(motors, packet["motor"], strict=True)
        for name in slot.dtype.names
    } | {name: packet[name] for name in LOW_CMD.names or () if name != "motor"}
    return {name: np.asarray(value) for name, value in fields.items()}


def _target_distance(recorded: bytes, replayed: bytes) -> float:
    """[rad] between the joint targets of two LowCmd datagrams that are else the same."""
    if len(recorded) != len(replayed) or len(recorded) != LOW_CMD.itemsize:
        return np.inf
    old, new = (np.frombuffer(data, LOW_CMD).copy() for data in (recorded, replayed))
    targets = [packet["motor"]["q"][:, :JOINTS].copy() for packet in (old, new)]
    for packet in (old, new):
        packet["motor"]["q"][:, :JOINTS] = 0
        packet["crc"] = 0
    if old.tobytes() != new.tobytes():
        return np.inf
    return float(np.abs(targets[0].astype(np.float64) - targets[1]).max())


def _remarks(log: FlightLog, bundle: Bundle) -> list[str]:
    about = log.about
    remarks = []
    if about.digest != bundle.contract.digest:
        remarks.append(
            f"recorded with another bundle: {about.policy} {about.digest[:12]}, "
            f"this is {bundle.source} {bundle.contract.digest[:12]}"
        )
    today = versions()
    for name, then in about.versions.items():
        if name in today and today[name] != then:
            remarks.append(f"recorded with {name} {then}, this is {today[name]}")
    if any(name in remark for remark in remarks for name in ("cpu ", "onnxruntime ", "numpy ")):
        remarks.append("another processor or library may round differently, by some 1e-6 rad")
    return remarks
