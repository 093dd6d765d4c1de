"""Several buses as one link, over python-can."""

import builtins
import contextlib
import select
import socket
import time

import can
import pytest

from rmll_common.errors import Failure
from rmll_onboard.interface.can_transport import CanTransport
from rmll_onboard.protocol.can_frame import Frame, pack, unpack
from rmll_onboard.settings.can_settings import Bus

BUSES = {name: Bus("virtual", f"link-{name}") for name in ("front", "rear")}
FROM_ROBOT, TO_ROBOT = [{0}, {0, 0x100}], [{1, 2}, {3}]


@pytest.fixture
def ends():
    """The daemon's end and the robot's."""
    with contextlib.ExitStack() as stack:
        yield [
            stack.enter_context(contextlib.closing(CanTransport(BUSES, heard)))
            for heard in (FROM_ROBOT, TO_ROBOT)
        ]


def frames(link):
    return [frame for datagram in link.receive() for frame in unpack(datagram)]


def test_frames_come_out_where_they_are_heard(ends):
    near, far = ends
    assert near.receive() == []
    commands = [Frame(0, 2, b"hello"), Frame(1, 3, b""), Frame(0, 1, b"12345678")]
    near.send(pack(commands))
    # in the order of each bus; nothing holds two buses together
    assert frames(far) == [commands[0], commands[2], commands[1]]
    assert frames(near) == []
    answers = [Frame(0, 0, b"a"), Frame(1, 0x100, b"b")]
    far.send(pack(answers))
    far.send(pack([Frame(1, 0, b"c")]))
    assert frames(near) == [*answers, Frame(1, 0, b"c")]
    assert near.name == "virtual link-front, virtual link-rear"


def test_what_no_actuator_sends_is_not_heard(ends):
    near, _ = ends
    odd = [
        can.Message(arbitration_id=0, is_extended_id=True),
        can.Message(arbitration_id=0, is_extended_id=False, is_remote_frame=True),
        can.Message(arbitration_id=0, is_extended_id=False, is_error_frame=True),
        can.Message(arbitration_id=0, is_extended_id=False, is_fd=True, data=bytes(64)),
        can.Message(arbitration_id=7, is_extended_id=False, data=b"stranger"),
        can.Message(arbitration_id=0, is_extended_id=False, data=b"robot"),
    ]
    with can.Bus(interface="virtual", channel="link-front") as stranger:
        for message in odd:
            stranger.send(message)
    assert frames(near) == [Frame(0, 0, b"robot")]


def test_a_flood_is_read_piece_by_piece(ends):
    near, far = ends
    flood = pack([Frame(1, 0, bytes([count % 256])) for count in range(500)])
    for _ in range(3):
        far.send(flood)
    counts = [len(frames(near)) for _ in range(8)]
    assert sum(counts) == 1500
    assert max(counts) <= 512


def test_the_parting_is_the_last_that_is_heard():
    far = CanTransport(BUSES, TO_ROBOT)
    parting = pack([Frame(0, 1, b"bye"), Frame(1, 3, b"bye")])
    near = CanTransport(BUSES, FROM_ROBOT, parting)
    near.send(pack([Frame(0, 1, b"work")]))
    near.close()
    heard = frames(far)
    assert heard[0] == Frame(0, 1, b"work")
    assert set(heard[1:]) == {Frame(0, 1, b"bye"), Frame(1, 3, b"bye")}
    far.close()


def test_a_bus_that_is_down_is_a_loss_and_no_error(ends):
    near, _ = ends
    for bus in near._buses:
        bus.shutdown()
    near.send(pack([Frame(0, 1, b"anyone?")]))
    assert near.receive() == []


def test_a_bus_that_cannot_be_opened_is_named_and_the_others_are_closed():
    buses = {"good": Bus("virtual", "leak"), "bad": Bus("nonsense", "can0")}
    with pytest.raises(Failure, match="bus bad: nonsense can0: "):
        CanTransport(buses, [set(), set()])
    with contextlib.closing(CanTransport({"a": Bus("virtual", "leak")}, [{1}])) as link:
        assert len(link._buses[0].channel) == 1  # nobody else is on it


def test_without_python_can_the_extra_is_named(monkeypatch):
    load = builtins.__import__

    def missing(name, *rest, **more):
        if name == "can":
            raise ModuleNotFoundError("No module named 'can'", name="can")
        return load(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(Failure, match=r"pip install 'rmll\[can\]'"):
        CanTransport(BUSES, FROM_ROBOT)


def has_interface_local_multicast() -> bool:
    try:
        with can.Bus(interface="udp_multicast", channel="ff01::1", port=free_port(), hop_limit=0):
            return True
    except (can.CanError, OSError):
        return False


def free_port() -> int:
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as sock:
        sock.bind(("::1", 0))
        return sock.getsockname()[1]


@pytest.mark.skipif(not has_interface_local_multicast(), reason="needs IPv6")
def test_buses_of_udp_multicast_keep_apart_and_hear_no_echo():
    buses = {name: Bus("udp_multicast", "ff01::1", port=free_port()) for name in ("a", "b")}
    with contextlib.ExitStack() as stack:
        near, far = (
            stack.enter_context(contextlib.closing(CanTransport(buses, heard)))
            for heard in (FROM_ROBOT, TO_ROBOT)
        )
        near.send(pack([Frame(0, 1, b"one"), Frame(1, 3, b"two"), Frame(0, 3, b"not here")]))
        heard = []
        for _ in range(200):
            heard += frames(far)
            if len(heard) == 2:
                break
            time.sleep(0.01)
        assert heard == [Frame(0, 1, b"one"), Frame(1, 3, b"two")]
        far.send(pack([Frame(0, 0, b"answer")]))
        # its own frames wait in front of the answer, and must not hide it
        select.select([near._buses[0]], [], [], 2)
        time.sleep(0.05)
        assert frames(near) == [Frame(0, 0, b"answer")]


def has_vcan() -> bool:
    try:
        with can.Bus(interface="socketcan", channel="vcan0"):
            return True
    except (can.CanError, OSError):
        return False


@pytest.mark.skipif(not has_vcan(), reason="needs SocketCAN with vcan0")
def test_socketcan():
    buses = {"a": Bus("socketcan", "vcan0")}
    with contextlib.ExitStack() as stack:
        near, far = (
            stack.enter_context(contextlib.closing(CanTransport(buses, heard)))
            for heard in ([{0}], [{1}])
        )
        near.send(pack([Frame(0, 1, b"one"), Frame(0, 5, b"not heard")]))
        heard = []
        for _ in range(200):
            heard += frames(far)
            if heard:
                break
            time.sleep(0.01)
        assert heard == [Frame(0, 1, b"one")]
        assert near.receive() == []
