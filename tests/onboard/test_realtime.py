"""Rights: taken where they are granted, refused in one line where not; each in a new process."""

import ctypes
import os
import resource
import socket
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has these rights")

_CAPBSET_DROP, _IPC_LOCK, _SYS_NICE = 24, 14, 23

ENTER = """
import os
from pathlib import Path
from rmll_common.errors import Failure
from rmll_onboard.runtime import realtime
from rmll_onboard.settings.runtime_settings import Realtime
try:
    realtime.enter(Realtime({}))
except Failure as failure:
    print(failure)
else:
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority,
          int(status["VmLck"].split()[0]) > 1000, sorted(os.sched_getaffinity(0)))
"""


def enter(wanted: str, without_rights: bool = False) -> str:
    def drop() -> None:
        libc = ctypes.CDLL(None)
        for capability in (_IPC_LOCK, _SYS_NICE):
            libc.prctl(_CAPBSET_DROP, capability)
        for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):
            resource.setrlimit(limit, (0, 0))

    entered = subprocess.run(
        [sys.executable, "-c", ENTER.format(wanted)],
        capture_output=True, text=True, preexec_fn=drop if without_rights else None,
    )  # fmt: skip
    assert (entered.returncode, entered.stderr) == (0, "")
    return entered.stdout.rstrip("\n")


def test_by_default_nothing_is_taken():
    ours = f"{os.sched_getscheduler(0)} {os.sched_getparam(0).sched_priority}"
    assert enter("", without_rights=True).startswith(f"{ours} False")


@pytest.mark.parametrize("wanted", ["priority=10", "lock_memory=True"])
def test_what_is_not_granted_is_told_with_what_it_takes(wanted):
    told = enter(wanted, without_rights=True)
    assert told.startswith(f"realtime.{wanted.partition('=')[0]}: ")
    assert "; it takes Limit" in told
    assert "\n" not in told


def test_a_core_that_is_not_there():
    told = enter("core=1023")
    assert told.startswith("realtime.core: ")
    assert told.endswith("; it takes a core that this process may use")


def test_a_robot_is_not_walked_with_less_than_was_asked_for(bundle_path, tmp_path):
    settings = tmp_path / "settings.yaml"
    settings.write_text("realtime: {core: 1023}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind(("127.0.0.1", 0))
        robot.setblocking(False)
        address = f"127.0.0.1:{robot.getsockname()[1]}"
        flags = ("--policy", bundle_path, "--settings", settings, "--robot-address", address)
        command = [sys.executable, "-m", "rmll_onboard.cli", *map(str, flags)]
        refused = subprocess.run(command, capture_output=True, text=True)
        assert refused.returncode == 1
        assert refused.stderr.startswith("rmll-onboard: realtime.core: ")
        assert refused.stderr.count("\n") == 1
        with pytest.raises(BlockingIOError):
            robot.recv(2048)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root surely has these rights")
def test_what_is_granted_is_taken():
    core = max(os.sched_getaffinity(0))
    taken = enter(f"priority=7, lock_memory=True, core={core}")
    assert taken == f"{os.SCHED_FIFO} 7 True [{core}]"
