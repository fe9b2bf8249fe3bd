"""The log as systemd's journal, a program and a person get it."""

import array
import json
import logging
import os
import socket
import sys
from datetime import datetime

import pytest

from tests.running import run_program
from traverse.daemon.system.log_setup import (
    JournalHandler,
    JsonLines,
    PlainLines,
    entry_of,
)

FIELDS = {"arm": "left", "device": "base", "code": "device.lost", "remedy": ""}


def record(text="no such port", level=logging.ERROR, fields=FIELDS, fault=None):
    made = logging.LogRecord(
        "traverse.daemon.monitoring.events",
        level,
        "/x/events.py",
        7,
        "%s",
        (text,),
        fault,
        func="_tell",
    )
    made.fields = fields
    return made


def read_entry(data: bytes) -> dict[str, str]:
    """A datagram read as the journal reads it: from the specification, not our code."""
    fields = {}
    while data:
        line, _, rest = data.partition(b"\n")
        name, equals, value = line.partition(b"=")
        if not equals:
            size = int.from_bytes(rest[:8], "little")
            value, rest = rest[8 : 8 + size], rest[8 + size :]
            assert rest[:1] == b"\n"
            rest = rest[1:]
        assert name.decode() not in fields
        fields[name.decode()] = value.decode()
        data = rest
    return fields


@pytest.fixture
def journal(tmp_path):
    """A journal's socket and a handler that sends to it."""
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(path))
        heard.settimeout(5)
        handler = JournalHandler(path)
        yield heard, handler
        handler.close()


def test_the_journal_gets_fields(journal):
    heard, handler = journal
    handler.emit(record("two\nlines"))
    assert read_entry(heard.recv(65536)) == {
        "MESSAGE": "two\nlines",
        "PRIORITY": "3",
        "SYSLOG_IDENTIFIER": "traverse",
        "LOGGER": "traverse.daemon.monitoring.events",
        "THREAD_NAME": "MainThread",
        "CODE_FILE": "/x/events.py",
        "CODE_LINE": "7",
        "CODE_FUNC": "_tell",
        "TRAVERSE_ARM": "left",
        "TRAVERSE_DEVICE": "base",
        "TRAVERSE_CODE": "device.lost",
    }


@pytest.mark.parametrize(
    ("level", "priority"), [("DEBUG", 7), ("INFO", 6), ("WARNING", 4), ("CRITICAL", 2)]
)
def test_levels_are_the_priorities_of_syslog(level, priority):
    entry = read_entry(entry_of(record(level=getattr(logging, level))))
    assert entry["PRIORITY"] == str(priority)


def test_a_fault_goes_with_its_stack():
    try:
        raise ValueError("of the test")
    except ValueError:
        entry = read_entry(entry_of(record(fault=sys.exc_info())))
    assert entry["MESSAGE"].startswith("no such port\nTraceback")
    assert entry["MESSAGE"].endswith("ValueError: of the test")


def test_a_long_entry_goes_as_a_sealed_file(journal):
    heard, handler = journal
    handler.emit(record("x" * 1_000_000))
    data, ancillary, _, _ = heard.recvmsg(100, socket.CMSG_SPACE(4))
    assert data == b""
    ((_, kind, numbers),) = ancillary
    assert kind == socket.SCM_RIGHTS
    (number,) = array.array("i", numbers)
    with open(number, "rb") as file:
        file.seek(0)
        assert read_entry(file.read())["MESSAGE"] == "x" * 1_000_000
        with pytest.raises(OSError, match="not permitted"):
            os.ftruncate(number, 0)


def test_what_the_journal_does_not_take_goes_to_standard_error(tmp_path, capsys):
    handler = JournalHandler(tmp_path / "nobody")
    handler.emit(record("two\nlines"))
    handler.close()
    assert capsys.readouterr().err == "<3>two\n<3>lines\n"


def test_a_journal_that_does_not_read_holds_nobody_up(journal, capsys):
    _, handler = journal
    for k in range(1000):
        handler.emit(record(f"entry {k}"))
    assert capsys.readouterr().err.endswith("<3>entry 999\n")


def test_json_is_one_object_a_line():
    try:
        raise ValueError("of the test")
    except ValueError:
        made = record("two\nlines", fault=sys.exc_info())
    line = JsonLines().format(made)
    assert "\n" not in line
    entry = json.loads(line)
    assert datetime.fromisoformat(entry.pop("time")).timestamp() == pytest.approx(
        made.created, abs=1e-3
    )
    assert entry.pop("fault").endswith("ValueError: of the test")
    assert entry == {
        "level": "error",
        "logger": "traverse.daemon.monitoring.events",
        "message": "two\nlines",
        "arm": "left",
        "device": "base",
        "code": "device.lost",
    }


def test_plain_lines_are_time_level_and_text():
    assert PlainLines().format(record()).endswith(" ERROR   no such port")


SCRIPT = """
import logging, os, sys
from pathlib import Path
from traverse.daemon.system import log_setup as logs
logs.JournalHandler.__init__.__defaults__ = (Path(sys.argv[1]),)
if sys.argv[2] == "matching":
    status = os.fstat(2)
    os.environ["JOURNAL_STREAM"] = f"{status.st_dev}:{status.st_ino}"
logs.start_log(sys.argv[3], sys.argv[4])
logging.getLogger("x").info("hello")
logging.getLogger("x").warning("careful")
"""


@pytest.mark.parametrize(
    ("arguments", "in_journal", "on_stderr"),
    [
        (("matching", "auto", "info"), 2, 0),
        (("matching", "plain", "warning"), 0, 1),
        (("matching", "json", "debug"), 0, 2),
        (("other", "auto", "info"), 0, 2),
        (("other", "journal", "info"), 2, 0),
    ],
)
def test_the_journal_is_taken_where_standard_error_goes_there(
    tmp_path, arguments, in_journal, on_stderr
):
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(path))
        done = run_program(
            sys.executable,
            "-c",
            SCRIPT,
            path,
            *arguments,
            env={**os.environ, "JOURNAL_STREAM": "0:0"},
        )
        heard.setblocking(False)
        datagrams = [heard.recv(65536) for _ in range(in_journal)]
        with pytest.raises(BlockingIOError):
            heard.recv(100)
    texts = [read_entry(data)["MESSAGE"] for data in datagrams]
    assert texts == ["hello", "careful"][:in_journal]
    assert len(done.stderr.splitlines()) == on_stderr
