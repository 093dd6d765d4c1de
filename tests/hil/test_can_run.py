"""``--link can`` of the commands, with the processes they start."""

import json
import subprocess
import sys
from pathlib import Path

import can
import pytest

from rmll_hil.robot.serve_can import on_free_ports
from rmll_onboard.settings.can_settings import Can

PATIENT = """
safety: {stale_ms: 1000, missed_ticks: 400, frozen_ms: 5000, actuator_ms: 1000, torque_error: 100,
  stuck: 100}
can: {reply_timeout_ms: 1000}
"""
"""Two processes must find each other; how well they keep time is nothing for a busy machine"""

FLAGS = ("--link", "can", "--seconds", 1, "--vx", 0, "--json", "--out", "here")


def hil(*flags: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rmll_hil.cli", *map(str, flags)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300)


def has_interface_local_multicast() -> bool:
    try:
        bus = on_free_ports(Can()).buses["fr"]
        with can.Bus(interface=bus.interface, channel=bus.channel, port=bus.port, hop_limit=0):
            return True
    except (can.CanError, OSError):
        return False


def test_a_walk_in_lockstep_is_recorded_and_replays(standing: Path, tmp_path: Path) -> None:
    (tmp_path / "patient.yaml").write_text("safety: {stuck: 100}")  # it makes no transitions
    patient = "--settings", "patient.yaml"
    done = hil("run", "--policy", standing, *FLAGS, *patient, "--lockstep", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert (figures["falls"], figures["fault"], figures["packets"]["lost"]) == (0, None, 0)
    log = tmp_path / "here" / "run.mcap"
    again = hil("replay", log, "--policy", standing, "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["different"] == 0


@pytest.mark.skipif(not has_interface_local_multicast(), reason="needs IPv6")
def test_real_time_over_multicast_that_stays_on_the_machine(
    standing: Path, tmp_path: Path, kept_time
) -> None:
    (tmp_path / "patient.yaml").write_text(PATIENT)
    patient = "--settings", "patient.yaml", "--command-timeout-ms", 1000
    with kept_time():
        done = hil("run", "--policy", standing, *FLAGS, *patient, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        figures = json.loads(done.stdout)
        assert (figures["falls"], figures["fault"]) == (0, None)
        assert figures["seconds"] == pytest.approx(1.0, abs=0.5)
        assert figures["packets"]["received"] > 100


def test_a_fault_plan_is_for_udp(standing: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text("[{fault: kick, velocity: [1, 0]}]")
    done = hil("run", "--policy", standing, *FLAGS, "--faults", "plan.yaml", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "rmll-hil: --faults: a fault plan needs --link udp\n"
