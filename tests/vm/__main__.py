"""`python -m tests.vm`: SocketCAN on a real vcan0. For a guest, as root of its own."""

import asyncio
import logging
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

from tests.vm import can_interface
from tests.vm.arm_checks import check_arm
from tests.vm.bus_checks import check_bus
from tests.vm.stream_checks import check_stream
from tests.vm.table import Table


async def run(folder: Path) -> int:
    table = Table()
    begun_s = time.monotonic()
    can_interface.add()
    await check_bus(table)
    await check_stream(table)
    # The outbox requires memory that is shared through a file, which 9p lacks.
    with tempfile.TemporaryDirectory() as work:
        await check_arm(table, Path(work))
        shutil.copytree(work, folder / "arm", symlinks=True)
    took = f"{time.monotonic() - begun_s:.0f} s in the guest"
    (folder / "table.txt").write_text(f"{table}\n{took}\n", "utf-8")
    print(f"\n{table}\n{took}", flush=True)  # noqa: T201 - this is the report
    return table.n_failed


if __name__ == "__main__":
    logging.getLogger("can").setLevel(logging.ERROR)
    sys.exit(min(1, asyncio.run(run(Path(os.environ["TRAVERSE_VM_OUT"])))))
