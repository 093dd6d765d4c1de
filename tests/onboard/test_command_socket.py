"""A program that leads, over a real UNIX socket."""

import os
import socket
import stat

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmll_common.errors import Failure, InputError
from rmll_onboard.commands.command_socket import LONGEST, SocketCommand, SocketOperator, decode
from rmll_onboard.commands.operator import OperatorCommand
from rmll_onboard.protocol.a1_remote import Remote
from rmll_onboard.state.modes import NS, Mode, Request

REMOTE = Remote()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "commands"


@pytest.fixture
def operator(path):
    operator = SocketOperator(path, frequency=9.0, silence=0.5)
    yield operator
    operator.close()


@pytest.fixture
def send(path, operator):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as program:
        yield lambda message: program.sendto(message, str(path))


def at(operator, seconds: float, mode: Mode = Mode.WALKING) -> OperatorCommand:
    return operator.orders(int(seconds * NS), mode, REMOTE)


def test_the_newest_message_counts_and_c_f_stays(operator, send):
    send(b'{"request": "stand"}')
    send(b'{"request": "walk", "vx": 0.5, "wz": -0.2, "frequency": 7}')
    assert at(operator, 1.0) == OperatorCommand(Request.WALK, (0.5, -0.2, 7.0))
    send(b'{"vx": 0.1}')
    assert at(operator, 1.2) == OperatorCommand(None, (0.1, 0.0, 7.0))
    send(b'{"request": "damp"}')
    assert at(operator, 1.3).request is Request.DAMP
    assert operator.complaint is None


def test_silence_ends_a_walk_and_nothing_else(operator, send):
    assert at(operator, 0.0, Mode.DAMPING) == OperatorCommand(None, (0.0, 0.0, 9.0))
    send(b'{"request": "walk", "vx": 0.5}')
    assert at(operator, 1.0).request is Request.WALK
    assert at(operator, 1.5).request is Request.WALK
    assert at(operator, 1.51, Mode.STANDING) == OperatorCommand(None, (0.0, 0.0, 9.0))
    assert operator.complaint is None
    assert at(operator, 1.6) == OperatorCommand(Request.STAND, (0.0, 0.0, 9.0))
    assert "no message" in operator.complaint
    send(b'{"request": "walk", "vx": 0.3}')
    assert at(operator, 2.0) == OperatorCommand(Request.WALK, (0.3, 0.0, 9.0))


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (b"walk", "malformed"),
        (b'{"request": "run"}', "run"),
        (b'{"vx": "fast"}', "vx"),
        (b'{"vx": NaN}', "malformed"),
        (b'{"vx": 1e999}', "range"),
        (b'{"vx": 101}', "<= 100"),
        (b'{"speed": 1}', "speed"),
        (b"[]", "object"),
        (b"\xff\xfe", "refused"),
        (b"", "refused"),
        (b'{"vx": 0.1}' + b" " * LONGEST, "256 bytes"),
    ],
)
def test_a_bad_message_is_told_and_changes_nothing(operator, send, message, words):
    send(b'{"request": "walk", "vx": 0.5}')
    send(message)
    assert at(operator, 1.0) == OperatorCommand(Request.WALK, (0.5, 0.0, 9.0))
    assert words in operator.complaint
    assert "\n" not in operator.complaint


def test_bad_messages_do_not_keep_a_robot_walking(operator, send):
    send(b'{"request": "walk"}')
    at(operator, 1.0)
    send(b"nonsense")
    assert at(operator, 1.6).request is Request.STAND


def test_a_flood_does_not_hold_the_loop(operator, send):
    operator._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    for count in range(10):
        send(b'{"vx": 0.%d}' % count)
    assert at(operator, 1.0).command[0] == 0.7  # the other two at the next tick
    assert at(operator, 1.1).command[0] == 0.9


@pytest.mark.fuzz
@given(st.binary(max_size=2 * LONGEST))
def test_any_bytes_are_a_wish_or_one_error(message):
    try:
        assert isinstance(decode(message), SocketCommand)
    except InputError as error:
        assert len(str(error)) < 200


def test_only_this_user_may_write(path, operator):
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_socket_left_behind_is_replaced_and_nothing_else(path, tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as left:
        left.bind(str(path))
    first = SocketOperator(path, 9.0, 1.0)
    with pytest.raises(Failure, match="another daemon"):
        SocketOperator(path, 9.0, 1.0)
    first.close()
    assert not path.exists()
    path.write_text("precious")
    with pytest.raises(InputError, match="no socket"):
        SocketOperator(path, 9.0, 1.0)
    assert path.read_text() == "precious"
    for wrong in (tmp_path / "nowhere" / "s", tmp_path / ("x" * 200)):
        with pytest.raises(InputError, match=r"^--commands \S+: [A-Z]"):  # no number of the system
            SocketOperator(wrong, 9.0, 1.0)


def test_the_umask_is_left_as_it_was(path, operator):
    before = os.umask(0o022)
    os.umask(before)
    assert before != 0o177
