"""``rmll-onboard``: walk a gait on the robot."""

import signal
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any

import msgspec

from rmll_contract import command, observation
from rmll_gaits.errors import Failure, InputError
from rmll_gaits.table import Commands
from rmll_onboard.bundle import Bundle, load_bundle
from rmll_onboard.controller import prove
from rmll_onboard.daemon import Daemon
from rmll_onboard.link import UdpLink
from rmll_onboard.log import Log
from rmll_onboard.loop import Loop
from rmll_onboard.pilot import FlagPilot, Pilot, RemotePilot, middle_frequency
from rmll_onboard.settings import Settings, as_yaml, load_settings

REMOTE_RULES = (
    "Remote: START stands up, A walks, B stands still, SELECT sits down, L2+B damps for good.\n"
    "Left stick: forward and back; right stick: turn. Ctrl-C sits down and ends."
)


def onboard(
    policy: Path | None = None,
    settings: Path | None = None,
    robot_address: str | None = None,
    vx: float | None = None,
    wz: float | None = None,
    frequency: float | None = None,
    seconds: float | None = None,
    check: bool = False,
    print_settings: bool = False,
    log: Path | None = None,
    json: bool = False,
) -> int:
    """Stand the robot up and walk, led by its wireless remote or by the flags.

    Example: rmll-onboard --policy policies/trot.onnx --vx 0.5 --seconds 20

    Args:
        policy: the bundle to run.
        settings: YAML file with what differs from --print-settings.
        robot_address: host:port of the robot, instead of the settings' one.
        vx: forward speed [m/s]. Any of vx, wz, frequency makes the robot walk by itself.
        wz: turning speed [rad/s], left positive.
        frequency: c_f, the least policy steps between two transitions; small is fast.
        seconds: walk so long by the flags, then sit down; without it until Ctrl-C.
        check: prove the bundle, print what is in it, and leave the network alone.
        print_settings: print all settings with their defaults, and do nothing else.
        log: CSV file for what the policy saw and did.
        json: print the report as one JSON object.
    """
    options = load_settings(settings)
    if print_settings:
        print(as_yaml(options))
        return 0
    if policy is None:
        raise InputError("--policy is missing: which bundle to run, e.g. policies/trot.onnx")
    bundle = load_bundle(policy)
    steps = prove(bundle)
    if check:
        _show(_contents(bundle, steps), json)
        return 0
    pilot = _pilot(bundle.table.commands, vx, wz, frequency, seconds)
    if isinstance(pilot, RemotePilot) and not json:
        print(REMOTE_RULES)
    return _walk(bundle, options, robot_address or options.link.robot_address, pilot, log, json)


def _walk(
    bundle: Bundle, settings: Settings, address: str, pilot: Pilot, log: Path | None, json: bool
) -> int:
    rows = None if log is None else Log(bundle)
    # opened first, so that a wrong path shows before the robot stands
    with (
        nullcontext() if log is None else log.open("x", newline="") as file,
        closing(UdpLink(address, settings.link.local_port)) as link,
    ):
        daemon = Daemon(bundle, settings, pilot, rows)
        loop = Loop(daemon, link)
        try:
            loop.run(settings.link.startup_timeout)
        finally:
            if rows is not None and file is not None:
                rows.write(file)
    _show({"gait": bundle.contract.gait} | daemon.report() | loop.report(), json)
    if daemon.fault:
        raise Failure(daemon.fault)
    return 130 if loop.stopped_by is signal.SIGINT else 0


def _pilot(
    commands: Commands,
    vx: float | None,
    wz: float | None,
    frequency: float | None,
    seconds: float | None,
) -> Pilot:
    if vx is None and wz is None and frequency is None:
        if seconds is not None:
            raise InputError("--seconds needs one of --vx, --wz, --frequency")
        return RemotePilot(commands, middle_frequency(commands))
    return FlagPilot(commands, vx or 0.0, wz or 0.0, frequency, seconds)


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


def _show(entries: dict[str, Any], json: bool) -> None:
    if json:
        print(msgspec.json.encode(entries).decode())
        return
    width = max(map(len, entries))
    for name, value in entries.items():
        print(f"{name:{width}}  {_plain(value)}")


def _plain(value: Any) -> str:
    match value:
        case dict():
            return ", ".join(f"{name} {_plain(inner)}" for name, inner in value.items())
        case list() | tuple():
            return " ".join(map(_plain, value))
        case float():
            return f"{value:.4g}"
        case None:
            return "-"
    return str(value)


def main() -> None:
    command.run("rmll-onboard", onboard)


if __name__ == "__main__":
    main()
