"""Claims on the system: granted where permitted, else reported and not used."""

import gc
import json
import os
import resource
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from pydantic import ValidationError

from tests.daemon.values import SetClock
from tests.running import run_program
from traverse.daemon.config.schema import RealtimeSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.system.realtime import NET_NEW_OBJECTS, freeze_objects, prepare

NOBODY = 65534
SCRIPT = """
import json, os, sys, threading
from pathlib import Path
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.system.realtime import prepare
from traverse.daemon.config.schema import RealtimeSection
if sys.argv[2] == "nobody" and os.getuid() == 0:
    os.setuid(65534)
ending = threading.Event()
reader = threading.Thread(target=ending.wait, name="driver-base", daemon=True)
reader.start()
events = []
section = RealtimeSection.model_validate_json(sys.argv[1])
prepare(section, [reader], EventLog(HostClock(), events.append))
status = Path("/proc/self/status").read_text()
locked = next(line for line in status.splitlines() if line.startswith("VmLck"))
print(json.dumps({
    "policy": os.sched_getscheduler(reader.native_id),
    "priority": os.sched_getparam(reader.native_id).sched_priority,
    "others": os.sched_getscheduler(0),
    "cpus": sorted(os.sched_getaffinity(reader.native_id)),
    "locked": int(locked.split()[1]),
    "events": [(e.severity, e.code, e.text, e.remedy) for e in events],
}))
ending.set()
"""


def prepared(user: str = "same", **section: object) -> dict:
    """Claims granted to a separate program, and its messages."""
    done = run_program(sys.executable, "-c", SCRIPT, json.dumps(section), user)
    return json.loads(done.stdout)


def may_have_priority() -> bool:
    """Whether this process may raise a thread's priority."""
    call = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(5))"
    command = [sys.executable, "-c", call]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def test_nothing_is_claimed_unless_configured():
    got = prepared()
    assert got["events"] == []
    assert got["policy"] == os.SCHED_OTHER
    assert got["cpus"] == sorted(os.sched_getaffinity(0))
    assert got["locked"] == 0


@pytest.mark.skipif(not may_have_priority(), reason="the system permits no priority")
def test_readers_alone_get_the_priority():
    got = prepared(priority=5)
    assert (got["policy"], got["priority"]) == (os.SCHED_FIFO, 5)
    assert got["others"] == os.SCHED_OTHER
    assert got["events"] == []


def test_readers_stay_on_their_cpus():
    first = min(os.sched_getaffinity(0))
    got = prepared(cpus=[first])
    assert got["cpus"] == [first]
    assert got["events"] == []


def test_memory_is_locked_where_there_is_no_limit():
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    got = prepared(lock_memory=True)
    if got["events"]:
        assert limit != resource.RLIM_INFINITY
    else:
        assert got["locked"] > 0


def test_all_that_is_refused_is_one_warning_with_its_remedy():
    got = prepared("nobody", priority=50, lock_memory=True)
    assert got["policy"] == os.SCHED_OTHER
    assert got["locked"] == 0
    ((severity, code, text, remedy),) = got["events"]
    assert (severity, code) == ("warning", "realtime.refused")
    assert "priority 50" in text
    assert "locked memory" in text
    assert "LimitRTPRIO=50" in remedy
    assert "LimitMEMLOCK=infinity" in remedy


def test_threads_have_their_names_in_the_kernel_and_the_start_is_frozen():
    ending, thresholds = threading.Event(), gc.get_threshold()
    reader = threading.Thread(target=ending.wait, name="driver-a-long-name")
    reader.start()
    try:
        before = gc.get_freeze_count()
        gc.disable()
        freeze_objects()
        prepare(RealtimeSection(), [reader], EventLog(SetClock(), print))
        name = Path(f"/proc/self/task/{reader.native_id}/comm").read_text()
        assert name == "driver-a-long-n\n"
        assert gc.get_freeze_count() > before
        assert gc.get_threshold()[0] == NET_NEW_OBJECTS
        assert gc.isenabled()
    finally:
        gc.enable()
        gc.unfreeze()
        gc.set_threshold(*thresholds)
        ending.set()
        reader.join()


def test_cpus_that_are_not_there_are_refused():
    with pytest.raises(ValidationError, match=r"may use the CPUs .* not"):
        RealtimeSection(cpus=(min(os.sched_getaffinity(0)), 4000))
