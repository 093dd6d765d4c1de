"""The UDP link over loopback."""

import select
import socket

import pytest

from rmll_common.errors import Failure, InputError
from rmll_onboard.interface.transport import UdpTransport


@pytest.fixture
def robot():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board:
        board.bind(("127.0.0.1", 0))
        board.settimeout(30)
        yield board


@pytest.fixture
def link(robot):
    link = UdpTransport(address_of(robot))
    yield link
    link.close()


def address_of(robot):
    return f"127.0.0.1:{robot.getsockname()[1]}"


def greet(link, robot):
    """The robot learns the link's address from its first datagram."""
    link.send(b"hello")
    data, address = robot.recvfrom(100)
    assert data == b"hello"
    return address


def wait(link):
    assert select.select([link._socket], [], [], 2)[0]


def test_all_that_came_is_read_the_oldest_first(link, robot):
    address = greet(link, robot)
    assert link.receive() == []
    sent = [bytes([count]) for count in range(5)]
    for datagram in sent:
        robot.sendto(datagram, address)
    wait(link)
    assert link.receive() == sent
    assert link.receive() == []


def test_strangers_are_not_heard(link, robot):
    address = greet(link, robot)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"stranger", address)
    robot.sendto(b"robot", address)
    wait(link)
    assert link.receive() == [b"robot"]
    assert link.receive() == []


def test_a_robot_that_is_not_there_is_a_loss_and_no_error(robot):
    address = address_of(robot)
    robot.close()
    link = UdpTransport(address)
    for _ in range(5):
        link.send(b"anyone?")
        assert link.receive() == []
    link.close()


def test_a_busy_port_is_named(robot):
    busy = robot.getsockname()[1]
    with pytest.raises(Failure, match=f"UDP port {busy} is in use"):
        UdpTransport("127.0.0.1:8007", busy)


@pytest.mark.parametrize("address", ["", "robot", ":80", "1.2.3.4:", "1.2.3.4:0", "h:99999", "h:x"])
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(InputError, match="expected host:port"):
        UdpTransport(address)


def test_an_unknown_host_is_named_and_may_be_known_later():
    with pytest.raises(Failure, match=r"^robot address no\.\.host:8007: unknown host 'no\.\.host'"):
        UdpTransport("no..host:8007")
    with pytest.raises(InputError, match="is no host name"):
        UdpTransport(f"{'ü' * 70}:8007")


def test_an_address_that_cannot_be_reached_is_named():
    with pytest.raises(Failure, match=r"^robot address 255\.255\.255\.255:1: \w"):
        UdpTransport("255.255.255.255:1")  # broadcasts are not allowed, so nothing is sent
