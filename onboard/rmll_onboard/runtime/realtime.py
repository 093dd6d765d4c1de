"""Rights over the machine's other work: the scheduler's priority, memory that stays, a core.

Each is a setting that is off by default. What is asked for and not granted ends the program before
anything is sent: a robot must not walk with less than its operator believes it has.
"""

import ctypes
import os
import sys
from collections.abc import Callable
from typing import Any

from rmll_common.errors import Failure
from rmll_onboard.settings.runtime_settings import Realtime

# linux/mman.h: what is mapped now and later, each page once it is touched; all pages at once would
# bring in every library and stack as a whole
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
"""linux/prctl.h"""


def enter(wanted: Realtime) -> None:
    """Take what ``wanted`` asks for: for the calling thread, and the memory of the process.

    Raises Failure, which names the setting, what was refused and what it takes.
    """
    if wanted.core >= 0:
        _take("core", "it takes a core that this process may use", _pin, wanted.core)
    if wanted.lock_memory:
        needs = "it takes LimitMEMLOCK=infinity in the unit, or ulimit -l unlimited"
        _take("lock_memory", needs, _lock_memory)
    if wanted.priority:
        needs = "it takes LimitRTPRIO=99 in the unit, or ulimit -r 99"
        _take("priority", needs, _prioritise, wanted.priority)
    _sharpen_timers()


def _take(name: str, needs: str, right: Callable[..., None], *values: Any) -> None:
    if sys.platform != "linux":
        raise Failure(f"realtime.{name}: only Linux has it, this is {sys.platform}")
    try:
        right(*values)
    except OSError as error:
        raise Failure(f"realtime.{name}: {error.strerror}; {needs}") from error


def _pin(core: int) -> None:
    os.sched_setaffinity(0, {core})


def _lock_memory() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _prioritise(priority: int) -> None:
    # a process that we start does not inherit it
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    os.sched_setscheduler(0, policy, os.sched_param(priority))


def _sharpen_timers() -> None:
    """Wake up on time: by default Linux is up to 50 us late, to wake up for several timers at once.

    Anybody may ask for it, so there is no setting; systems that do not know it go on without.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1))
