"""Notifications to systemd, on a real datagram socket of the test's own."""

import os
import socket
import time

import pytest

from traverse.daemon.system.systemd import Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """A socket like systemd's, and its name as in the environment."""
    name = str(tmp_path / "notify")
    if request.param == "abstract":
        name = f"@traverse-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(name.replace("@", "\0", 1))
        heard.settimeout(5)
        yield heard, name


def test_each_message_is_one_datagram(manager):
    heard, name = manager
    notifier = Notifier({"NOTIFY_SOCKET": name})
    notifier.ready()
    notifier.status("two\nlines")
    notifier.feed()
    notifier.stopping(2.5)
    notifier.starting(10)
    assert [heard.recv(4096) for _ in range(5)] == [
        b"READY=1",
        b"STATUS=two lines",
        b"WATCHDOG=1",
        b"STOPPING=1\nEXTEND_TIMEOUT_USEC=2500000",
        b"EXTEND_TIMEOUT_USEC=10000000",
    ]


def test_a_reload_tells_the_monotonic_time_at_which_it_began(manager):
    heard, name = manager
    before_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    Notifier({"NOTIFY_SOCKET": name}).reloading()
    after_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
    first, second = heard.recv(4096).decode().split("\n")
    assert first == "RELOADING=1"
    key, _, value = second.partition("=")
    assert key == "MONOTONIC_USEC"
    assert before_us <= int(value) <= after_us


@pytest.mark.parametrize("name", ["", "/no/such/socket", "@no-such-socket"])
def test_without_a_manager_nothing_happens(name):
    Notifier({"NOTIFY_SOCKET": name} if name else {}).ready()


def test_a_manager_that_does_not_listen_does_not_hold_the_daemon_up(manager):
    _, name = manager
    notifier = Notifier({"NOTIFY_SOCKET": name})
    for _ in range(10_000):  # far more than the socket's queue holds
        notifier.feed()


@pytest.mark.parametrize(
    ("told", "expected_s"),
    [
        ({"WATCHDOG_USEC": "3000000"}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": str(os.getpid())}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({}, None),
    ],
)
def test_the_watchdog_is_that_of_this_process(told, expected_s):
    assert Notifier({"NOTIFY_SOCKET": "@x", **told}).watchdog_s == expected_s
