"""How the unit lives: starts, reloads, is killed, hangs, ends."""

import asyncio
import os
import re
import signal
import time

from tests.end_to_end.listener import Listener
from tests.vm.system import unit
from tests.vm.system.preparation import FOLDER
from traverse.protocol.messages import Status
from traverse.testing.waiting import until

SOON_S = 150.0
MEASURING = ("ready", "doubt")  # with all devices; the arm is not identified


class Life:
    def __init__(self, listener: Listener) -> None:
        self._listener = listener

    async def start(self) -> str:
        """`systemctl start` returns when the daemon has said READY."""
        begun_s = time.monotonic()
        await asyncio.to_thread(unit.systemctl, "start", unit.NAME)
        took_s = time.monotonic() - begun_s
        assert unit.shown("ActiveState") == "active"
        assert unit.shown("Type") == "notify"
        status_text = unit.shown("StatusText")
        assert status_text, "no STATUS line"
        return f"READY after {took_s:.1f} s: {status_text}"

    async def be_ready(self) -> str:
        """Encoders and pedal are there."""
        await self._ready_since(0)
        status = self._listener.statuses[-1]
        return ", ".join(f"{d.id} on {d.port}" for d in status.drivers)

    async def reload(self) -> str:
        """A new arm file is taken over by the process that runs."""
        pid, before = unit.main_pid(), self._listener.statuses[-1].model
        arm = FOLDER / "arm.toml"
        text = arm.read_text("utf-8")
        changed = re.sub(r"(?m)^radius_mm = .*$", "radius_mm = 2.5", text)
        assert changed != text
        arm.write_text(changed, "utf-8")
        await asyncio.to_thread(unit.systemctl, "reload", unit.NAME)
        await until(
            lambda: self._listener.statuses[-1].model != before, "a model", SOON_S
        )
        assert unit.main_pid() == pid, "another process"
        await unit.until(_is_active, "active after RELOADING", SOON_S)
        now = self._listener.statuses[-1].model
        return f"model {str(before)[:12]} became {str(now)[:12]}, same process"

    async def refuse(self) -> str:
        """A file with a mistake changes nothing."""
        pid, before = unit.main_pid(), self._listener.statuses[-1].model
        arm = FOLDER / "arm.toml"
        good = arm.read_text("utf-8")
        arm.write_text(good.replace("radius_mm", "radius_inch"), "utf-8")
        await asyncio.to_thread(unit.systemctl, "reload", unit.NAME)
        event = await self._listener.event("reload.refused", None, SOON_S)
        arm.write_text(good, "utf-8")
        assert unit.main_pid() == pid, "another process"
        assert self._listener.statuses[-1].model == before
        await unit.until(_is_active, "active after RELOADING", SOON_S)
        assert "radius_inch" in event.text
        assert "\\n" not in event.text, "lines for a terminal, in an event"
        return f"refused: {event.text}"

    async def lose_bus(self) -> str:
        """The interface is taken down and up; the unit stays."""
        pid = unit.main_pid()
        unit.run("ip", "link", "set", "vcan0", "down")
        await self._listener.event("device.lost", True, SOON_S)
        await unit.until(lambda: "lost" in unit.shown("StatusText"), "STATUS", SOON_S)
        status_text = unit.shown("StatusText")
        n = len(self._listener.statuses)
        unit.run("ip", "link", "set", "vcan0", "up")
        await self._listener.event("device.lost", False, SOON_S)
        await self._ready_since(n - 1)
        assert unit.main_pid() == pid, "another process"
        return f"lost and back, same process; meanwhile: {status_text}"

    async def be_killed(self) -> str:
        """A daemon that is killed is restarted."""
        return await self._restarted(signal.SIGKILL)

    async def be_stopped(self) -> str:
        """A daemon that is stuck is detected by the watchdog."""
        result = await self._restarted(signal.SIGSTOP)
        assert "Watchdog timeout" in unit.journal(), "not by the watchdog"
        return f"{result}; WatchdogSec={unit.shown('WatchdogUSec')}"

    async def be_upgraded(self) -> str:
        """Packages are installed over themselves: running services run again."""
        pid, n = unit.main_pid(), len(self._listener.statuses)
        folder = os.environ["TRAVERSE_VM_OUT"]
        names = ("traverse", "traverse-lab", "traverse-fleet")
        files = [f"{folder}/{name}.deb" for name in names]
        await asyncio.to_thread(unit.run, "dpkg", "-i", *files)
        await self._ready_since(n)
        assert unit.main_pid() not in {0, pid}, "the old process"
        return "restarted by it, and measuring"

    async def end(self) -> str:
        """It ends in order."""
        begun_s = time.monotonic()
        await asyncio.to_thread(unit.systemctl, "stop", unit.NAME)
        took_s = time.monotonic() - begun_s
        assert unit.shown("Result") == "success", unit.shown("Result")
        await until(
            lambda: self._listener.statuses[-1].state == "offline", "offline", SOON_S
        )
        return f"result success after {took_s:.1f} s"

    async def _restarted(self, number: signal.Signals) -> str:
        pid, n = unit.main_pid(), len(self._listener.statuses)
        restarts = int(unit.shown("NRestarts"))
        begun_s = time.monotonic()
        os.kill(pid, number)
        await unit.until(
            lambda: unit.main_pid() not in {0, pid}, "a new process", SOON_S
        )
        new_s = time.monotonic() - begun_s
        await self._ready_since(n)
        assert int(unit.shown("NRestarts")) == restarts + 1, unit.shown("NRestarts")
        ready_s = time.monotonic() - begun_s
        return f"a new process after {new_s:.1f} s, measuring after {ready_s:.1f} s"

    async def _ready_since(self, n: int) -> None:
        def ready_statuses() -> list[Status]:
            return [s for s in self._listener.statuses[n:] if s.state in MEASURING]

        await until(ready_statuses, "a status with all devices", SOON_S)


def _is_active() -> bool:
    return unit.shown("ActiveState") == "active"
