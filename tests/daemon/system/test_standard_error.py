"""The log is written to whatever standard error is, and never waits for it."""

import fcntl
import os
import resource
import socket
import sys
import threading

import pytest

from tests.running import run_program
from traverse.daemon.system.standard_error import StandardError

LINE = "x" * 99 + "\n"


class Stream:
    def __init__(self, number):
        self.number = number

    def fileno(self):
        return self.number


@pytest.fixture
def pipe():
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 8192)
    yield reading, writing
    os.close(writing)
    os.close(reading)


def filled(error, most=2000):
    for n in range(most):
        error.write(LINE)
        if error.n_dropped:
            return n
    raise AssertionError("it takes everything")


def test_a_pipe_that_nobody_reads_costs_lines_and_no_time(pipe):
    reading, writing = pipe
    error = StandardError(Stream(writing))
    n_written = filled(error)
    for _ in range(10):
        error.write(LINE)
    assert error.n_dropped == 11
    assert os.read(reading, 100_000).decode() == LINE * n_written
    error.write("now\n")
    assert (
        os.read(reading, 1000) == b"11 lines dropped here: they were not taken\nnow\n"
    )
    error.write("then\n")
    assert os.read(reading, 1000) == b"then\n"
    assert error.n_dropped == 11


def test_a_socket_that_nobody_reads_does_not_hold_it_either():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        error = StandardError(Stream(ours.fileno()))
        filled(error, 100_000)


def test_a_long_line_reaches_a_reader_whole(pipe):
    reading, writing = pipe
    text = "".join(chr(0x100 + k % 100) for k in range(3000)) + "\n"  # 6001 bytes
    StandardError(Stream(writing)).write(text)
    assert os.read(reading, 100_000).decode() == text


def test_a_file_and_an_object_without_descriptor_take_it(tmp_path, capsys):
    with (tmp_path / "log").open("w") as file:
        StandardError(file).write("line\n")
    assert (tmp_path / "log").read_text() == "line\n"
    StandardError().write("line\n")  # pytest's object
    assert capsys.readouterr().err == "line\n"


def test_a_file_that_may_not_grow_costs_lines(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with (tmp_path / "log").open("w") as file:
        error = StandardError(file)
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
        try:
            error.write("lost\n")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        error.write("line\n")
    assert error.n_dropped == 1
    first, second = (tmp_path / "log").read_text().splitlines()
    assert first.startswith("1 line dropped here")
    assert second == "line"


def test_a_reader_that_has_gone_is_no_error():
    reading, writing = os.pipe()
    os.close(reading)
    error = StandardError(Stream(writing))
    thread = threading.Thread(target=error.write, args=(LINE,))
    thread.start()
    thread.join()
    os.close(writing)
    assert error.n_dropped == 1


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_a_program_begun_without_standard_streams_has_harmless_ones(tmp_path, closed):
    program = (
        "import os, sys; from traverse.__main__ import _open_standard_streams as s; "
        "s(); n = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY); "
        "sys.stderr.write('lost'); sys.stderr.flush(); os.write(n, str(n).encode())"
    )
    out = tmp_path / "out"
    run_program(
        "sh", "-c", f'exec "$0" -c "$1" "$2" {closed}', sys.executable, program, out
    )
    assert int(out.read_text()) > 2
