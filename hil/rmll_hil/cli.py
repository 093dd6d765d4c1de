"""``rmll-hil``: the emulated robot, alone or with the daemon that walks it."""

import sys
from contextlib import closing
from pathlib import Path
from typing import Annotated

import tyro

from rmll_common import command_line
from rmll_common.errors import InputError
from rmll_common.output_file import output_file
from rmll_gaits.load import library_names
from rmll_hil.robot.can_robot import CanRobot
from rmll_hil.robot.emulator import Emulator, EmulatorSettings
from rmll_hil.robot.fault_plan import Plan, load_plan
from rmll_hil.robot.serve import Reply, Stop, listen, save, serve
from rmll_hil.robot.serve_can import serve_can
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.settings.can_settings import Can
from rmll_onboard.settings.runtime_settings import Kind, load_settings
from rmll_robots import A1

Robot = Annotated[EmulatorSettings, tyro.conf.OmitArgPrefixes]
SHIPPED = tuple(map(Path, library_names()))


def serve_command(
    robot: Robot = EmulatorSettings(),  # noqa: B008 - frozen
    host: str = "127.0.0.1",
    port: int = 8007,
    reply: Reply = "stream",
    link: Kind = "udp",
    settings: Path | None = None,
    log: Path | None = None,
    faults: Path | None = None,
) -> None:
    """Emulate an A1's low-level board on UDP, in real time, until Ctrl-C or SIGTERM.

    Or, with --link can, a robot of actuators on the buses of the daemon's settings file.

    Example: rmll-hil serve --port 8007, then rmll-onboard --policy trot

    Args:
        robot: What the emulated robot is like.
        host: Address to listen on; the default is reachable from this machine only.
        port: UDP port; 0 takes a free one and prints it.
        reply: "stream" sends states at 500 Hz from the first command on, "echo" one a command.
        link: What it speaks; host, port and reply are those of udp.
        settings: The daemon's settings file, for its section can.
        log: Write the true motion to this .npz file at the end, or to truth.npz in this folder.
        faults: YAML file with a fault plan: what goes wrong, and when.
    """
    plan = load_plan(faults, A1) if faults else ()
    log = log and output_file("--log", log, "truth.npz", ".npz")
    if link == "can":
        _serve_can(robot, load_settings(settings).can, plan, log)
        return
    with Stop().on_signals() as stop, listen(host, port) as sock:
        emulator = Emulator(robot, plan=plan)
        print("listening on {}:{}".format(*sock.getsockname()), flush=True)
        realtime_factor = serve(emulator, sock, reply, stop)
    _told(emulator, realtime_factor, log)


def _serve_can(robot: EmulatorSettings, can: Can, plan: Plan, log: Path | None) -> None:
    if plan:
        raise InputError("--faults: a fault plan needs --link udp")
    layout = Layout(can, A1)  # first, for it says best what does not fit
    wire = CanRobot(can, A1)
    link = CanTransport(can.buses, layout.commands())
    with Stop().on_signals() as stop, closing(link) as buses:
        emulator = Emulator(robot, wire=wire)
        print(f"listening on {buses.name}", flush=True)
        realtime_factor = serve_can(emulator, buses, stop)
    _told(emulator, realtime_factor, log)


def _told(emulator: Emulator, realtime_factor: float, log: Path | None) -> None:
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
    vx: float | None = None,
    wz: float | None = None,
    frequency: tuple[float, ...] | None = None,
    robot: Robot = EmulatorSettings(),  # noqa: B008 - frozen
    link: Kind | None = None,
    settings: Path | None = None,
    lockstep: bool = False,
    faults: Path | None = None,
    json: bool = False,
    out: Path | None = None,
) -> None:
    """Walk a policy with the real daemon on the emulated robot, and report how it went.

    Emulator and daemon run as two processes in real time, or with --lockstep in one, taking
    turns: repeatable and faster. Leaves a summary, the flight recorder's log, the same as a table
    with the truth beside it, and the foot-contact picture.

    Example: rmll-hil run --policy trot --seconds 20 --vx 0.5

    Args:
        policy: The bundle to run, a file or the name of a shipped one.
        seconds: How long to walk, after standing up.
        vx: Forward speed [m/s]; 0.5 by default, or what is nearest to it in the gait's range.
        wz: Turning speed [rad/s], left positive; straight on by default.
        frequency: c_f, the least policy steps between two transitions; the middle of the gait's
            range by default. Several values share the seconds, and make one more picture.
        robot: What the emulated robot is like.
        link: What it speaks, an A1's udp or can; instead of the settings' one.
        settings: The daemon's settings file.
        lockstep: Take turns in one process instead of running in real time.
        faults: YAML file with a fault plan: what goes wrong, and when.
        json: Print the summary as one JSON object.
        out: New folder for the results; hil-runs/GAIT-TIME by default.
    """
    # the emulator's own process has no use for what a run needs
    from rmll_hil.runs.run import run

    daemon = load_settings(settings).over(link)
    run(policy, seconds, vx, wz, frequency, robot, daemon, lockstep, faults, json, out)


def replay_command(
    log: Annotated[Path, tyro.conf.Positional],
    *,
    policy: Path | None = None,
    policies: Path = Path("policies"),
    json: bool = False,
) -> None:
    """Send a recorded walk through today's daemon; every datagram it sends must be the same.

    Takes what --record and rmll-hil run leave. The first difference is shown field by field.

    Example: rmll-hil replay hil-runs/trot-20250101-120000/run.mcap

    Args:
        log: The .mcap file.
        policy: The bundle that it was recorded with, a file or the name of a shipped one; the
            gait's by default.
        policies: Where the shipped bundles are.
        json: Print the result as one JSON object.
    """
    from rmll_hil.replay.replay_command import replay_command as replay

    replay(log, policy, policies, json)


def faults_command(
    policy: Path = Path("trot"),
    only: tuple[str, ...] = (),
    realtime: bool = False,
    times: int = 1,
    jobs: int = 1,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Provoke faults while a policy walks, and see that the daemon does what it should.

    The daemon's own loop runs in virtual time, so that nothing depends on how busy the machine
    is: a fault takes about a second of a processor. With --realtime it is a process of its own
    that talks UDP, and a fault takes about five seconds.

    Example: rmll-hil faults --policy trot --only silent_board killed

    Args:
        policy: The bundle that walks, a file or the name of a shipped one.
        only: Names of faults; all by default.
        realtime: Over UDP and in real time. An empty loop is measured beside each fault; if even
            that was late, a wrong reaction is told as a machine that is too busy.
        times: How often each fault is provoked, with other noise of the sensors each time.
        jobs: How many at a time; in real time more than one needs as many idle processors.
        out: Write the table to this Markdown file, or to faults.md in this folder.
        json: Print the table as one JSON object, a list of results for each fault.
    """
    from rmll_hil.faults.fault_command import faults

    faults(policy, only, realtime, times, jobs, out, json)


def feet_command(
    policies: tuple[Path, ...] = SHIPPED,
    only: tuple[str, ...] = (),
    seconds: float = 8.0,
    jobs: int = 1,
    out: Path | None = None,
    json: bool = False,
) -> None:
    """Walk on foot sensors of any unit, bias, drift and noise, which the daemon has to learn.

    A table, foot sensors x gait: adherence, which has to be within 0.02 of that of a daemon that
    is told the true unit and bias, without a fall. In lockstep; a walk takes some seconds.

    Example: rmll-hil feet --policies trot pronk --only "gain 0.2, bias 500"

    Args:
        policies: The bundles that walk, files or names of shipped ones; all shipped by default.
        only: Names of rows; all by default.
        seconds: How long each walk is.
        jobs: How many at a time.
        out: Write the table to this Markdown file, or to feet.md in this folder.
        json: Print the table as one JSON list.
    """
    from rmll_hil.runs.feet_command import feet

    feet(policies, only, seconds, jobs, out, json)


def main() -> None:
    commands = {
        "serve": serve_command,
        "run": run_command,
        "replay": replay_command,
        "faults": faults_command,
        "feet": feet_command,
    }
    command_line.run("rmll-hil", commands)


if __name__ == "__main__":
    main()
