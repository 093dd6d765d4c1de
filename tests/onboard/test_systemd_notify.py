"""What a service manager hears, on a real socket."""

import os
import socket

import pytest

from rmll_onboard.runtime.systemd_notify import SystemdNotifier

SECOND = 1_000_000_000


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """The manager's socket, and the address that it puts into the environment."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.settimeout(30)
        if request.param == "path":
            address = str(tmp_path / "notify")
            listener.bind(address)
        else:
            listener.bind("")  # Linux chooses an abstract name
            address = "@" + listener.getsockname()[1:].decode()
        yield listener, {"NOTIFY_SOCKET": address}


def heard(listener: socket.socket) -> list[str]:
    listener.setblocking(False)
    words = []
    while True:
        try:
            words.append(listener.recv(100).decode())
        except BlockingIOError:
            return words


def test_it_says_ready_once_and_alive_twice_as_often_as_it_must(manager):
    listener, environment = manager
    service = SystemdNotifier(
        environment | {"WATCHDOG_USEC": "1000000", "WATCHDOG_PID": str(os.getpid())}
    )
    for tick in range(401):
        service.ready()
        service.alive(5 * SECOND + tick * SECOND // 200)
    service.stopping()
    assert heard(listener) == ["READY=1", *["WATCHDOG=1"] * 5, "STOPPING=1"]
    service.close()


@pytest.mark.parametrize(
    "watchdog", [{}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "1000", "WATCHDOG_PID": "1"}]
)
def test_without_a_watchdog_of_ours_nobody_is_kept_informed(manager, watchdog):
    listener, environment = manager
    service = SystemdNotifier(environment | watchdog)
    service.alive(SECOND)
    assert heard(listener) == []
    service.close()


def test_a_manager_that_does_not_read_holds_nobody_up(manager):
    listener, environment = manager
    service = SystemdNotifier(environment | {"WATCHDOG_USEC": "2"})
    for tick in range(5000):
        service.alive(tick * SECOND)
    assert 0 < len(heard(listener)) < 5000
    service.close()


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": "/nobody/there"}])
def test_where_nobody_listens_nothing_happens(environment):
    service = SystemdNotifier(environment | {"WATCHDOG_USEC": "1000000"})
    service.ready()
    service.alive(SECOND)
    service.stopping()
    service.close()
