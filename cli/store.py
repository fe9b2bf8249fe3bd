"""`traverse store`: messages of all arms, into a database and into files."""

import asyncio
import re
import socket
import time
from typing import Annotated

import typer

from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.refusals import (
    UNREACHABLE,
    client_errors,
    end,
    refusals,
    refuse,
)
from traverse.cli.gateway.running import report, until_signal
from traverse.fleet.database import BadValueError, StoreAwayError, StoreRefusedError
from traverse.fleet.opening import open_database
from traverse.fleet.tables import migrate
from traverse.plurals import counted

PATIENCE_S = 30.0
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,40}")


def store(
    *,
    broker: BrokerOptions,
    database: str = "traverse-store.db",
    scans: str = "traverse-scans",
    group: str = "store",
    member: str | None = None,
    gap_s: Annotated[float, typer.Option(min=1.0)] = 60.0,
    list_s: Annotated[float, typer.Option(min=1.0)] = 600.0,
    keep_s: Annotated[int, typer.Option(min=0)] = 3600,
) -> None:
    """Store what all arms publish at a broker.

    Points, events and states go into a database, scans into Parquet by arm and day. A
    message is acknowledged once it is stored; each counts once; what is missing is
    asked for again. Many members may run at once. Ends on Ctrl-C or SIGTERM with a
    line of sums. Exit status 3: also if there is no database within 30 s.

    Args:
        database: File of SQLite, or postgresql://user@host:port/database; its password
            in PGPASSFILE or PGPASSWORD.
        scans: Folder, or a URI of pyarrow such as s3://bucket/scans.
        group: Name of the group whose members share the messages.
        member: Name in the group, the same each time; else the host's.
        gap_s: Ask for numbers that are missing so long [s].
        list_s: Ask each arm so often what it has [s].
        keep_s: The broker keeps messages for an absent member [s].
    """
    from traverse.fleet.member import Member, MemberSettings
    from traverse.fleet.member_name import NameTakenError
    from traverse.fleet.scan_files import ScanFiles
    from traverse.fleet.store import Store

    name = re.sub(r"[^A-Za-z0-9_.-]", "-", member or socket.gethostname())[:40]
    for option, text in (("--group", group), ("--member", member or name)):
        if not _NAME.fullmatch(text):
            refuse(f"{option} {text!r}: expected 1 to 40 letters, digits, - _ and .")
    address = broker.address()
    settings = MemberSettings(
        group=group, member=name, gap_s=gap_s, list_s=list_s, keep_s=keep_s
    )
    with refusals(StoreRefusedError, BadValueError):
        files = ScanFiles(scans, name)
        first = open_database(database)
        until_s, is_waiting_announced = time.monotonic() + PATIENCE_S, False
        while True:  # a server that begins with this computer takes a moment
            try:
                steps = migrate(first)
                break
            except StoreAwayError as error:
                if time.monotonic() > until_s:
                    end(UNREACHABLE, f"traverse store: {error}")
                if not is_waiting_announced:
                    report(f"{error}; waiting {PATIENCE_S:g} s for it")
                is_waiting_announced = True
                time.sleep(0.5)
        if steps:
            report(f"{first.name}: {counted(steps, 'step')} of tables made")

    def open_store() -> Store:
        return Store(open_database(database), files)

    work = Member(address, settings, open_store, first, report)
    report(f"{group}/{name}: from {address} to {first.name} and {scans}")
    with client_errors():
        try:
            asyncio.run(until_signal(work.run()))
        except StoreRefusedError as error:
            refuse(str(error))
        except NameTakenError:
            refuse(
                f"another member of the group {group} is called {name}; give each a "
                "--member of its own"
            )
        finally:
            work.name.release()
    counts = work.counts
    report(
        f"{counted(counts.stored, 'message')} stored, {work.n_refused} refused, "
        f"{counts.dropped} dropped, {counted(work.gaps.asked, 'gap')} asked for, "
        f"{counted(work.gaps.lost, 'number')} lost"
    )
