"""Real-time settings, as far as the system permits.

Reader threads get a real-time priority and CPUs of their own, pages are locked in
memory, and objects of the start are hidden from the garbage collector.
docs/explanation/real-time.md explains benefits and costs.
"""

import ctypes
import gc
import os
import resource
import threading
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from traverse.daemon.config.schema import RealtimeSection
from traverse.daemon.monitoring.events import EventLog

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
CAP_IPC_LOCK = 14
NAME_BYTES = 15  # of a thread, in the kernel
# Python collects after 700, that is seven times a second, mostly while a point
# is made; nearly none of these objects are in cycles. This many take 2 to 4 MB.
NET_NEW_OBJECTS = 20_000


def prepare(
    section: RealtimeSection, readers: Iterable[threading.Thread], events: EventLog
) -> None:
    """Set up memory and the running reader threads.

    Refusals are one event; the daemon measures without them.
    """
    running = [thread for thread in readers if thread.native_id is not None]
    _set_thread_names(running)
    refused = [*_schedule(section, running), *_lock(section)]
    if refused:
        events.report(
            "warning",
            "realtime.refused",
            f"the system refuses: {'; '.join(text for text, _ in refused)}",
            remedy="; ".join(dict.fromkeys(remedy for _, remedy in refused))
            + "; or take it out of [realtime]",
        )


def freeze_objects() -> None:
    """Hide existing objects from the garbage collector, and run it seldom."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(NET_NEW_OBJECTS)
    gc.enable()


def _set_thread_names(threads: Iterable[threading.Thread]) -> None:
    for thread in threads:
        path = Path(f"/proc/self/task/{thread.native_id}/comm")
        with suppress(OSError):
            path.write_bytes(thread.name.encode()[:NAME_BYTES])


def _schedule(
    section: RealtimeSection, threads: Iterable[threading.Thread]
) -> list[tuple[str, str]]:
    """Set priority and CPUs of threads; return refusals with remedies."""
    refused = {}
    for thread in threads:
        number = thread.native_id or 0
        try:
            if section.cpus:
                os.sched_setaffinity(number, section.cpus)
        except OSError as error:
            text = f"CPUs {list(section.cpus)} for the readers ({error.strerror})"
            refused[text] = "allow sched_setaffinity, and these CPUs, in the unit"
        try:
            if section.priority:
                parameter = os.sched_param(section.priority)
                os.sched_setscheduler(number, os.SCHED_FIFO, parameter)
        except OSError as error:
            text = f"priority {section.priority} ({error.strerror})"
            refused[text] = f"set LimitRTPRIO={section.priority} or more in the unit"
    return list(refused.items())


def _lock(section: RealtimeSection) -> list[tuple[str, str]]:
    """Lock present and future pages; return refusals with remedies."""
    if not section.lock_memory:
        return []
    remedy = "set LimitMEMLOCK=infinity in the unit"
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and not _may_lock_all():
        # Under a limit, a later request for memory would be refused.
        return [(f"locked memory without a limit (it is {limit} bytes)", remedy)]
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT):
        reason = os.strerror(ctypes.get_errno())
        return [(f"locked memory ({reason})", remedy)]
    return []


def _may_lock_all() -> bool:
    for line in Path("/proc/self/status").read_text("utf-8").splitlines():
        name, _, value = line.partition(":")
        if name == "CapEff":
            return bool(int(value, 16) >> CAP_IPC_LOCK & 1)
    return False
