import json
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from rmll_onboard.protocol.a1_packets import decode_state, encode_command
from rmll_onboard.state.robot_state import MODE_BRAKE, MODE_SERVO, MotorCommand

BRAKE = encode_command(MotorCommand())


@contextmanager
def server(*flags: str) -> Iterator[tuple[subprocess.Popen, tuple[str, int]]]:
    """A running ``rmll-hil serve`` and its address."""
    command = [sys.executable, "-m", "rmll_hil.cli", "serve", "--port", "0", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            assert process.stdout
            address = process.stdout.readline().decode().split()[-1]
            host, port = address.rsplit(":", 1)
            yield process, (host, int(port))
        finally:
            process.kill()


@pytest.fixture
def client() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(60)
        yield sock


def receive(client: socket.socket, count: int) -> list:
    return [decode_state(client.recv(2048)) for _ in range(count)]


def test_streams_states_from_the_first_command_on(client: socket.socket, tmp_path: Path) -> None:
    log = tmp_path / "truth.npz"
    with server("--log", str(log)) as (process, address):
        client.settimeout(0.3)
        client.sendto(b"not a command", address)
        with pytest.raises(TimeoutError):
            client.recv(2048)
        client.settimeout(60)
        client.sendto(BRAKE, address)
        states = receive(client, 50)
        assert set(np.diff([state.tick for state in states])) == {2}
        process.send_signal(signal.SIGTERM)
        assert process.wait(60) == 0
    with np.load(log) as saved:
        counters = json.loads(str(saved["counters"]))
        assert (counters["received"], counters["rejected"]) == (2, 1)
        assert counters["sent"] >= 50
        assert len(saved["truth"]) >= 50 * 2 / 5


def test_echoes_one_state_a_command(client: socket.socket) -> None:
    with server("--reply", "echo") as (_, address):
        for _ in range(5):
            client.sendto(BRAKE, address)
            receive(client, 1)
        client.settimeout(0.2)
        with pytest.raises(TimeoutError):
            client.recv(2048)


def test_the_board_brakes_when_its_commander_falls_silent(client: socket.socket) -> None:
    with server("--command-timeout-ms", "100") as (_, address):
        command = MotorCommand(mode=np.full(12, MODE_SERVO, np.uint8))
        client.sendto(encode_command(command), address)
        modes = [int(state.mode[0]) for state in receive(client, 100)]
        assert MODE_SERVO in modes
        assert modes[-1] == MODE_BRAKE


def test_answers_whoever_commanded_last(client: socket.socket) -> None:
    with server() as (_, address), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        client.sendto(BRAKE, address)
        receive(client, 1)
        other.settimeout(60)
        other.sendto(BRAKE, address)
        receive(other, 1)


def test_a_fault_plan_is_carried_out(client: socket.socket, tmp_path: Path) -> None:
    plan = tmp_path / "plan.yaml"
    plan.write_text("- {fault: network, direction: from_robot, loss: 1}")
    with server("--faults", str(plan)) as (process, address):
        client.settimeout(0.3)
        client.sendto(BRAKE, address)
        with pytest.raises(TimeoutError):
            client.recv(2048)
        assert process.poll() is None


def test_a_busy_port_is_one_line() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "rmll_hil.cli", "serve", "--port", str(port)]
        result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr == (
        f"rmll-hil: cannot listen on 127.0.0.1:{port}: Address already in use\n"
    )


def test_ctrl_c_ends_a_server_that_nobody_called() -> None:
    with server() as (process, _):
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0


@pytest.mark.parametrize(
    ("flags", "code", "complaint"),
    [
        (("--port", "80808"), 2, "--port 80808: expected 0 to 65535"),
        (("--port", "-5"), 2, "--port -5: expected 0 to 65535"),
        (("--host", "no..host"), 1, "cannot listen on no..host:8007: "),
        (("--host", "ü" * 70), 1, "no host name"),
        (("--host", "192.0.2.7", "--port", "0"), 1, "cannot listen on 192.0.2.7:0: Cannot assign"),
        (("--log", "truth.txt"), 2, "--log truth.txt: expected a .npz file in a folder that"),
    ],
)
def test_what_cannot_be_served_is_one_line(flags, code, complaint, tmp_path) -> None:
    command = [sys.executable, "-m", "rmll_hil.cli", "serve", *flags]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (code, "")
    assert complaint in done.stderr and done.stderr.startswith("rmll-hil: ")
    assert done.stderr.count("\n") == 1 and "Errno" not in done.stderr
