"""`python -m tests.vm.system`: the installed package with systemd, in a guest.

For the Python of the package: the modules that are checked are those of the package.
"""

import asyncio
import os
import sys
from pathlib import Path

from tests.vm.system import guard_checks, page_checks
from tests.vm.system.consumer import following
from tests.vm.system.delivery_checks import Delivery
from tests.vm.system.life_checks import Life
from tests.vm.system.pedal import Pedal
from tests.vm.table import Table


async def run(table: Table) -> int:
    async def kill() -> str:
        await delivery.acknowledge()
        return await life.be_killed()

    with Pedal() as pedal:
        async with following() as listener:
            life, delivery = Life(listener), Delivery(listener, pedal)
            await table.check("the unit starts", life.start)
            await table.check("an arm on vcan0, all devices ready", life.be_ready)
            await table.check("points by pedal and command", delivery.arrive)
            await table.check("nothing of ours runs as root", guard_checks.be_nobody)
            await table.check("exposure by systemd-analyze", guard_checks.be_shut)
            await table.check("where the daemon can write", guard_checks.stay_inside)
            await table.check("devices it can reach", guard_checks.reach_devices)
            await table.check("the password", guard_checks.keep_secret)
            await table.check("the page's unit, behind its token", page_checks.ask)
            await table.check("the page's unit, exposure", page_checks.be_shut)
            await table.check("traverse-lab", page_checks.add_lab)
            await table.check("systemctl reload", life.reload)
            await table.check("systemctl reload, bad arm file", life.refuse)
            await table.check("ip link set vcan0 down, up", life.lose_bus)
            await table.check("a broker that is away", delivery.wait_for_broker)
            await table.check("kill -9 of the broker", delivery.lose_broker)
            await table.check("kill -9 of the daemon", kill)
            await table.check("nothing acknowledged is lost", delivery.lose_nothing)
            await table.check("SIGSTOP, and the watchdog", life.be_stopped)
            await table.check("systemctl stop", life.end)
            await table.check("systemctl start, points go on", delivery.go_on)
            await table.check("dpkg -i, as an upgrade", life.be_upgraded)
    return table.n_failed


if __name__ == "__main__":
    table_file = Path(os.environ["TRAVERSE_VM_OUT"]) / "table.jsonl"
    sys.exit(min(1, asyncio.run(run(Table(table_file)))))
