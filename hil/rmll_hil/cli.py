"""``rmll-hil``: the emulated robot, alone or with the daemon that walks it."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from rmll_contract import command
from rmll_hil.emulator import Emulator, Settings
from rmll_hil.serve import Reply, Stop, listen, save, serve

Robot = Annotated[Settings, tyro.conf.OmitArgPrefixes]


def serve_command(
    robot: Robot = Settings(),  # noqa: B008 - frozen
    host: str = "127.0.0.1",
    port: int = 8007,
    reply: Reply = "stream",
    log: Path | None = None,
) -> None:
    """Emulate an A1's low-level board on UDP, in real time, until Ctrl-C or SIGTERM.

    Example: rmll-hil serve --port 8007, then rmll-onboard --policy policies/trot.onnx

    Args:
        robot: What the emulated robot is like.
        host: Address to listen on; the default is reachable from this machine only.
        port: UDP port; 0 takes a free one and prints it.
        reply: "stream" sends states at 500 Hz from the first command on, "echo" one a command.
        log: Write the true motion to this .npz file at the end.
    """
    stop = Stop()
    with listen(host, port) as sock:
        emulator = Emulator(robot)
        print("listening on {}:{}".format(*sock.getsockname()), flush=True)
        realtime_factor = serve(emulator, sock, reply, stop)
    print(
        f"{emulator.now_ms / 1000:.1f} s at {realtime_factor:.3f} x real time; commands: "
        f"{emulator.received} received, {emulator.rejected} rejected; {emulator.sent} states sent",
        file=sys.stderr,
    )
    if log:
        save(emulator, log, realtime_factor)


def run_command(
    policy: Path,
    seconds: float = 20.0,
    vx: float = 0.5,
    wz: float = 0.0,
    frequency: float | None = None,
    robot: Robot = Settings(),  # noqa: B008 - frozen
    lockstep: bool = False,
    json: bool = False,
    out: Path | None = None,
) -> None:
    """Walk a policy with the real daemon on the emulated robot, and report how it went.

    Emulator and daemon run as two processes in real time, or with --lockstep in one, taking
    turns: repeatable and faster. Leaves a summary, a log and the foot-contact picture.

    Example: rmll-hil run --policy policies/trot.onnx --seconds 20 --vx 0.5

    Args:
        policy: The bundle to run.
        seconds: How long to walk, after standing up.
        vx: Forward speed [m/s].
        wz: Turning speed [rad/s], left positive.
        frequency: c_f, the least policy steps between two transitions; the middle of the gait's
            range by default.
        robot: What the emulated robot is like.
        lockstep: Take turns in one process instead of running in real time.
        json: Print the summary as one JSON object.
        out: New folder for the results; hil-runs/GAIT-TIME by default.
    """
    # the emulator's own process has no use for what a run needs
    from rmll_hil.run import run

    run(policy, seconds, vx, wz, frequency, robot, lockstep, json, out)


def main() -> None:
    command.run("rmll-hil", {"serve": serve_command, "run": run_command})


if __name__ == "__main__":
    main()
