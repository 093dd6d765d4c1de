"""A row of the fault table in virtual time: one process, no waiting, and always the same."""

from pathlib import Path

from rmll_common.errors import Failure
from rmll_hil.faults.fault_rows import FaultRow, Reaction
from rmll_hil.faults.fault_trial import MOTION, VX, FaultTrial
from rmll_hil.faults.virtual_time import Killed, VirtualTime
from rmll_onboard.commands.operator import FlagOperator, RemoteOperator
from rmll_onboard.control.bundle import load_bundle
from rmll_onboard.runtime.cache_warmup import CacheWarmer
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.loop import Loop
from rmll_onboard.settings.runtime_settings import Motion, RuntimeSettings, Safety


def run(row: FaultRow, trial: FaultTrial, policy: Path) -> tuple[Reaction, int | None, str]:
    """The reaction, after how many milliseconds of the robot, and the daemon's words.

    To be called from the main thread, the only one that hears signals.
    """
    bundle = load_bundle(policy)
    settings = RuntimeSettings(motion=Motion(**MOTION), safety=Safety(**row.settings))
    commands = bundle.table.commands
    operator = (
        RemoteOperator(commands, commands.middle_frequency, settings.steering.deadband)
        if row.remote
        else FlagOperator(commands, vx=VX)
    )
    daemon = Daemon(bundle, settings, operator)
    clock = VirtualTime(trial, trial.signals)
    cache_warmer = CacheWarmer(bundle, settings)
    loop = Loop(daemon, clock, settings.realtime, cache_warmer=cache_warmer, clock=clock)
    try:
        loop.run(settings.link.startup_timeout)
        told = daemon.fault or "; ".join(daemon.report().warnings)
    except Killed:
        told = ""
    except Failure as failure:
        told = str(failure)
    clock.alive = False
    while trial.begin_ms is not None and trial.found is None:
        clock.sleep(daemon.period * 1e-9)
    reaction, after_ms = trial.found or trial.reaction()
    return reaction, after_ms, told
