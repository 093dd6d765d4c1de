"""What a log says about itself: enough to judge it without the bundle, and to replay it with."""

import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta

from rmll_common.errors import InputError
from rmll_gaits.table import MachineTable
from rmll_onboard.recording.telemetry import columns
from rmll_onboard.settings.runtime_settings import RuntimeSettings

if TYPE_CHECKING:  # as in rmll_onboard.recording.telemetry
    from rmll_onboard.control.bundle import Bundle

FORMAT = 1
_CPU_FEATURES = ("fma", "avx2", "avx512f", "avx512_bf16", "amx_tile", "asimd", "sve")
"""What a matrix kernel may be chosen by"""


class LogMetadata(msgspec.Struct, frozen=True):
    """Plain data; settings and table are checked when they are asked for."""

    format: int
    gait: str
    policy: str
    """File name of the bundle"""
    digest: str
    """Of the bundle's contract"""
    control_hz: Annotated[int, Meta(gt=0)]
    settings: dict[str, object]
    table: dict[str, object]
    """The gait's automaton"""
    columns: list[str]
    """Names of the numbers in :attr:`rmll_onboard.recording.telemetry.Inside.values`"""
    arguments: list[str]
    """Of the program that recorded, the operator's flags among them"""
    versions: dict[str, str]
    """Of what computed: interpreter, libraries, processor"""
    started: str
    """Date and time, UTC; empty where time was not real"""
    unix_offset_ns: int
    """To be added to the log's times, which are monotonic, to get those of the calendar"""

    def machine_table(self) -> MachineTable:
        """Raises InputError."""
        return MachineTable.from_dict(self.table)

    def daemon_settings(self) -> RuntimeSettings:
        """Raises InputError if they are not those of this version."""
        try:
            return msgspec.convert(_today(self.settings), RuntimeSettings)
        except msgspec.ValidationError as error:
            raise InputError(f"recorded with settings of another version: {error}") from error


def _today(settings: dict[str, object]) -> dict[str, object]:
    """The same under the names that they have now."""
    today = dict(settings)
    for section in msgspec.structs.fields(RuntimeSettings):
        renamed = getattr(section.type, "RENAMED", {})
        if isinstance(values := settings.get(section.name), dict):
            today[section.name] = {renamed.get(name, name): v for name, v in values.items()}
    return today


def describe(bundle: "Bundle", settings: RuntimeSettings, real_time: bool) -> LogMetadata:
    """A log that begins now."""
    contract = bundle.contract
    unix_ns = time.time_ns()
    return LogMetadata(
        format=FORMAT,
        gait=contract.gait,
        policy=bundle.source,
        digest=contract.digest,
        control_hz=contract.control_hz,
        settings=msgspec.to_builtins(settings),
        table=contract.table,
        columns=columns(contract),
        arguments=sys.argv[1:],
        versions=versions(),
        started=time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(unix_ns // 10**9))
        if real_time
        else "",
        unix_offset_ns=unix_ns - time.monotonic_ns() if real_time else 0,
    )


def versions() -> dict[str, str]:
    """What the same answers to the same datagrams may depend on."""
    libraries = {name: version(name) for name in ("rmll", "numpy", "onnxruntime")}
    return {"python": platform.python_version(), **libraries, "cpu": _cpu()}


def _cpu() -> str:
    """The processor and those of its features that a matrix kernel is chosen by."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.machine()
    entries = [line.partition(":")[::2] for line in text.partition("\n\n")[0].splitlines()]
    found = {name.strip(): value.strip() for name, value in entries}
    flags = (found.get("flags") or found.get("Features") or "").split()
    name = found.get("model name", platform.machine())
    return " ".join([name, *(feature for feature in _CPU_FEATURES if feature in flags)])
