"""The daemon on CAN: how it begins, and how it ends whatever happens."""

import subprocess
import sys
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from rmll_common.errors import Failure
from rmll_gaits.load import load_gait
from rmll_hil.robot.mit_actuator import MitActuator
from rmll_onboard.commands.operator import FlagOperator
from rmll_onboard.interface.can_layout import Layout
from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.interface.robot_interface import open_transport
from rmll_onboard.protocol.can_frame import unpack
from rmll_onboard.protocol.mit_packets import ENTER, EXIT
from rmll_onboard.runtime.daemon import Daemon
from rmll_onboard.runtime.loop import Loop
from rmll_onboard.settings.can_settings import Bus, Can
from rmll_onboard.settings.runtime_settings import LinkSettings, RuntimeSettings
from rmll_robots import A1


@pytest.fixture
def settings(brisk: RuntimeSettings) -> RuntimeSettings:
    buses = {name: Bus("virtual", f"loop-{name}") for name in Can().buses}
    can = msgspec.structs.replace(Can(), buses=buses)
    return msgspec.structs.replace(
        brisk, link=LinkSettings(kind="can", startup_timeout=0.3), can=can
    )


def orders(frames, layout) -> list[list[bytes]]:
    """What each actuator was told, in its order."""
    told = [[] for _ in layout.joints]
    who = {key: joint for joint, key in enumerate(zip(layout.bus, layout.id, strict=True))}
    for bus, identifier, data in frames:
        told[who[bus, identifier]].append(data)
    return told


@pytest.mark.parametrize("crash", [False, True])
def test_it_ends_in_damping_and_then_switches_the_actuators_off(bundle, settings, clock, crash):
    layout = Layout(settings.can, A1)
    daemon = Daemon(bundle, settings, FlagOperator(load_gait("trot").commands, seconds=1.0))
    if crash:
        daemon.tick = None  # type: ignore[method-assign]
    with closing(CanTransport(settings.can.buses, layout.commands())) as robot:
        with (
            pytest.raises(TypeError if crash else Failure) as ended,
            closing(open_transport(settings, A1)) as link,
        ):
            Loop(daemon, link, settings.realtime, clock=clock).run(settings.link.startup_timeout)
        frames = []
        while datagrams := robot.receive():
            frames += unpack(datagrams[0])
    if not crash:
        assert "nothing from actuator FR_hip_joint, actuator FR_thigh_joint" in str(ended.value)
        assert str(ended.value).endswith("the IMU")
    actuator = MitActuator(settings.can.models["AK10-9"], 1)
    for told in orders(frames, layout):
        assert (ENTER in told) is not crash
        assert set(told[-3:]) == {EXIT}
        commands = [data for data in told[:-3] if data != ENTER]
        assert len(commands) > 350  # two seconds of them
        assert not any(data.startswith(b"\xff" * 7) for data in commands)
        for data in commands:
            command = actuator.read(data)
            assert command.kp == 0
            assert command.kd == pytest.approx(A1.damping_kd)


def onboard(*flags: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rmll_onboard.cli", *map(str, flags)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(
    ("text", "flags", "code", "words"),
    [
        ("", [], 2, "--link can: no remote there; lead by --vx, --gamepad or --commands"),
        ("can: {actuators: {}}", ["--vx", 0], 2, "can: actuators: 'FL_calf_joint' is missing"),
        (
            "can: {buses: {fr: {interface: morse, channel: x}, fl: {interface: morse, channel: y},"
            " rr: {interface: morse, channel: z}, rl: {interface: morse, channel: w}}}",
            ["--vx", 0],
            1,
            "bus fr: morse x: ",
        ),
    ],
)
def test_what_is_wrong_is_one_line(bundle_path: Path, tmp_path: Path, text, flags, code, words):
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    done = onboard("--policy", bundle_path, "--link", "can", "--settings", path, *flags)
    assert done.returncode == code, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert f"rmll-onboard: {words}" in done.stderr
