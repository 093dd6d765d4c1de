"""``rmll-onboard``: walk a gait on the robot."""

import os
import signal
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Any

import msgspec

from rmll_common import command_line
from rmll_common.errors import Failure, InputError
from rmll_contract import observation
from rmll_onboard.commands.command_socket import SocketOperator
from rmll_onboard.commands.gamepad import GamepadOperator, open_gamepad
from rmll_onboard.commands.operator import FlagOperator, Operator, RemoteOperator
from rmll_onboard.control.bundle import Bundle, load_bundle
from rmll_onboard.control.controller import prove
from rmll_onboard.control.shipped_policies import find_policy
from rmll_onboard.interface.robot_interface import open_transport
from rmll_onboard.recording.log_metadata import describe
from rmll_onboard.recording.recorder import Recorder, log_path
from rmll_onboard.runtime import realtime, timing
from rmll_onboard.runtime.cache_warmup import cache_warmer
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.loop import Loop
from rmll_onboard.runtime.report_text import report_text
from rmll_onboard.runtime.systemd_notify import SystemdNotifier
from rmll_onboard.settings.runtime_settings import Kind, RuntimeSettings, as_yaml, load_settings
from rmll_onboard.state.reports import RunReport

BUTTONS = (
    "START stands up, A walks, B stands still, SELECT sits down, L2+B damps for good.\n"
    "Left stick: forward and back; right stick: turn; up and down: faster and slower steps.\n"
    "Ctrl-C sits down and ends."
)


def onboard(
    policy: Path | None = None,
    settings: Path | None = None,
    link: Kind | None = None,
    robot_address: str | None = None,
    vx: float | None = None,
    wz: float | None = None,
    frequency: tuple[float, ...] | None = None,
    seconds: float | None = None,
    gamepad: Path | None = None,
    commands: Path | None = None,
    check: bool = False,
    print_settings: bool = False,
    record: Path | None = None,
    report: bool = False,
    json: bool = False,
) -> int:
    """Stand the robot up and walk, led by its remote, a gamepad, a program or the flags.

    Example: rmll-onboard --policy trot --vx 0.5 --seconds 20

    Args:
        policy: the bundle to run, a file or the name of a shipped one.
        settings: YAML file with what differs from --print-settings.
        link: udp to an A1, or can to the actuators of the settings, instead of the settings' one.
        robot_address: host:port of the robot, instead of the settings' one.
        vx: forward speed [m/s]. Any of vx, wz, frequency makes the robot walk by itself.
        wz: turning speed [rad/s], left positive.
        frequency: c_f, the least policy steps between two transitions; small is fast. Several
            values share the seconds.
        seconds: walk so long by the flags, then sit down; without it until Ctrl-C.
        gamepad: the USB gamepad that leads, such as /dev/input/event3; auto takes the first one.
        commands: new UNIX socket on which a program leads, with JSON messages.
        check: prove the bundle, print what is in it, and leave the network alone.
        print_settings: print all settings with their defaults, and do nothing else.
        record: new .mcap file for all that is received, sent and thought, or a folder for it;
            see rmll-hil replay.
        report: print at the end how well time was kept, as percentiles.
        json: print all that there is to report as one JSON object.
    """
    options = load_settings(settings).over(link, robot_address)
    if print_settings:
        print(as_yaml(options))
        return 0
    if policy is None:
        raise InputError("--policy is missing: which bundle to run, a file or a name such as trot")
    policy = find_policy(policy)
    bundle = load_bundle(policy)
    steps = prove(bundle)
    if check:
        contents = {"bundle": str(policy)} | _contents(bundle, steps)
        contents["deadband"] = options.steering.deadband
        _show(contents if json else contents | {"provenance": _essentials(bundle)}, json)
        return 0
    flags = {"vx": vx, "wz": wz, "frequency": frequency}
    given = {name: value for name, value in flags.items() if value is not None}
    with _leading(bundle, options, given, seconds, gamepad, commands) as operator:
        if options.link.kind == "can" and isinstance(operator, RemoteOperator):
            raise InputError("--link can: no remote there; lead by --vx, --gamepad or --commands")
        if isinstance(operator, RemoteOperator | GamepadOperator) and not json:
            print(BUTTONS)
        return _walk(bundle, options, operator, record, report, json)


def _walk(
    bundle: Bundle,
    settings: RuntimeSettings,
    operator: Operator,
    record: Path | None,
    percentiles: bool,
    json: bool,
) -> int:
    recorder = None
    if record is not None:
        about = describe(bundle, settings, real_time=True)
        path = log_path(record, bundle.contract.gait)
        recorder = Recorder(path, about, settings.record.max_mb)
    # the recorder is closed last: waiting for the disk must not keep the robot from damping
    with (
        nullcontext() if recorder is None else closing(recorder),
        closing(open_transport(settings, bundle.robot)) as link,
        closing(SystemdNotifier(os.environ)) as service,
    ):
        daemon = Daemon(bundle, settings, operator)
        realtime.enter(settings.realtime)
        keep = recorder and recorder.keep
        warmer = cache_warmer(bundle, settings)
        loop = Loop(daemon, link, settings.realtime, keep, service, warmer)
        loop.run(settings.link.startup_timeout)
    kept = loop.report()
    report = RunReport.of(daemon.report(), kept, recorder and recorder.report())
    entries = msgspec.to_builtins(report)
    if not json:
        if percentiles:
            print(timing.table(kept))
        del entries["timekeeping"]
    _show(entries, json)
    if daemon.fault:
        raise Failure(daemon.fault)
    return 130 if loop.stopped_by is signal.SIGINT else 0


@contextmanager
def _leading(
    bundle: Bundle,
    settings: RuntimeSettings,
    flags: dict[str, Any],
    seconds: float | None,
    gamepad: Path | None,
    commands: Path | None,
) -> Iterator[Operator]:
    """The one operator that was asked for; by default it is the person with the remote."""
    ranges = bundle.table.commands
    leaders = [f"--{name}" for name in flags]
    leaders += [name for name, value in (("--gamepad", gamepad), ("--commands", commands)) if value]
    if len(leaders) > 1 and (gamepad or commands):
        raise InputError(f"{' and '.join(leaders)}: one can lead, not both")
    if seconds is not None and not flags:
        raise InputError("--seconds needs one of --vx, --wz, --frequency")
    frequency, deadband = ranges.middle_frequency, settings.steering.deadband
    if gamepad:
        device = None if str(gamepad) == "auto" else gamepad
        with closing(
            GamepadOperator(open_gamepad(device), ranges, frequency, deadband)
        ) as operator:
            yield operator
    elif commands:
        silence = settings.steering.silence
        with closing(SocketOperator(commands, frequency, silence)) as operator:
            yield operator
    elif flags:
        yield FlagOperator(ranges, seconds=seconds, **flags)
    else:
        yield RemoteOperator(ranges, frequency, deadband)


def _contents(bundle: Bundle, steps: int) -> dict[str, Any]:
    contract, commands = bundle.contract, bundle.table.commands
    return {
        "gait": contract.gait,
        "robot": contract.robot,
        "states": list(bundle.table.states),
        "profile": contract.profile,
        "observation": observation.size(contract.observation),
        "vx": commands.vx,
        "wz": commands.wz,
        "frequency": commands.frequency,
        "kp": contract.kp,
        "kd": contract.kd,
        "action_scale": contract.action_scale,
        "torque_limit": contract.torque_limit,
        "policy_hz": contract.policy_hz,
        "control_hz": contract.control_hz,
        "trace_steps": steps,
        "digest": contract.digest,
        "provenance": contract.provenance,
    }


def _essentials(bundle: Bundle) -> dict[str, Any]:
    """How the policy came to be, without the hundred settings of its training."""
    provenance = bundle.contract.provenance
    long = dict.fromkeys(("settings", "stages"), "(--json tells them)")
    return provenance | {name: word for name, word in long.items() if provenance.get(name)}


def _show(entries: dict[str, Any], json: bool) -> None:
    if json:
        print(msgspec.json.encode(entries).decode())
        return
    print(report_text(entries))


def main() -> None:
    command_line.run("rmll-onboard", onboard)


if __name__ == "__main__":
    main()
