"""A real daemon under a service manager that the test plays."""

import asyncio
import json
import signal
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.daemon.monitoring import prometheus_reader
from tests.end_to_end.listener import listening
from tests.end_to_end.measuring import measuring
from tests.end_to_end.service.service_manager import Manager, stopped_thread
from tests.end_to_end.workbench import REST, Workbench
from tests.mosquitto import HOST, free_port
from traverse.testing.waiting import until

WATCHDOG_S = 1.0
FED = "WATCHDOG=1"


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    path = tmp_path / "notify"
    manager = Manager(path)
    monkeypatch.setenv("NOTIFY_SOCKET", str(path))
    monkeypatch.setenv("WATCHDOG_USEC", str(int(WATCHDOG_S * 1e6)))
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    yield manager
    manager.close()


def add_tables(text: str, bench: Workbench) -> None:
    path = bench.folder / "daemon.toml"
    path.write_text(f"{path.read_text('utf-8')}\n{text}\n", "utf-8")


@pytest.mark.needs("mosquitto")
async def test_a_service_is_ready_watched_reloaded_and_stopped(
    bench: Workbench, manager: Manager
) -> None:
    secret = "correct-horse-battery"
    (bench.folder / "secret").write_text(secret, "utf-8")
    (bench.folder / "secret").chmod(0o600)
    bench.write_simulator(REST)
    bench.write_daemon(broker='username = "arm"\npassword_file = "secret"')
    options = ("--log-format", "json", "--log-level", "debug")
    async with listening(bench.host, bench.port, bench.arm) as listener:
        with bench.simulator() as simulator:
            await simulator.says("ready base")
            with bench.daemon(*options) as daemon:
                await until(lambda: manager.has("READY=1"), "ready")
                before = manager.listen()[: manager.listen().index("READY=1")]
                assert f"EXTEND_TIMEOUT_USEC={(8 + 12 + 5) * 10**6}" in before
                await until(
                    lambda: manager.status() == "measuring: 1 device",
                    "nothing is in doubt",
                )
                await until(lambda: manager.has(FED, 3), "the watchdog is fed")

                arm = bench.arm_file.read_text("utf-8")
                bench.arm_file.write_text(arm.replace("origin_mm", "origin"), "utf-8")
                daemon.process.send_signal(signal.SIGHUP)
                await until(lambda: manager.has("READY=1", 2), "the old goes on")
                refused_event = await listener.event("reload.refused")
                assert "origin_mm: is missing" in refused_event.text
                assert "\\n" not in refused_event.text  # one line, for people
                bench.arm_file.write_text(f"{arm}\n", "utf-8")
                daemon.process.send_signal(signal.SIGHUP)
                await until(lambda: manager.has("READY=1", 3), "the new measures")
                await listener.event("reload.done")

                assert await daemon.stop() == 0
                messages = [x.partition("=")[0] for x in manager.listen()]
                kept = ("READY", "RELOADING", "STOPPING")
                assert [x for x in messages if x in kept] == [
                    *("READY", "RELOADING", "READY", "RELOADING", "READY", "STOPPING")
                ]
                assert messages.count("MONOTONIC_USEC") == 2
                assert manager.status().startswith("stopping: 1 device")
                entries = [json.loads(line) for line in daemon.log.splitlines()]
    assert secret not in daemon.log + daemon.output
    refused = next(e for e in entries if e.get("code") == "reload.refused")
    assert (refused["arm"], refused["level"]) == (bench.arm, "error")
    assert listener.healths[-1].latencies["handling"].n > 0


async def test_what_is_absent_is_reported_and_does_not_keep_a_service_from_starting(
    tmp_path: Path, manager: Manager
) -> None:
    bench = Workbench(tmp_path, HOST, free_port())
    bench.write_simulator(REST)
    bench.write_daemon()
    with bench.daemon("--keep-trying") as daemon:
        await until(lambda: manager.has("READY=1"), "ready")
        await until(
            lambda: manager.status().startswith("measuring: 0 devices, base lost"),
            "the device is missed",
        )
        assert ", broker lost since " in manager.status()
        assert "device.lost" in daemon.log
        assert "broker.lost" in daemon.log
        fed = manager.listen().count(FED)
        await until(lambda: manager.has(FED, fed + 3), "it lives all the same")
        with bench.simulator() as simulator:
            await simulator.says("ready base")
            await until(
                lambda: manager.status().startswith("measuring: 1 device, broker"),
                "the device is there",
            )
            assert await daemon.stop() == 0


@pytest.mark.needs("mosquitto")
async def test_a_reader_that_is_stuck_stops_the_feeding(
    bench: Workbench, manager: Manager
) -> None:
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, daemon):
        await until(lambda: manager.has("READY=1"), "ready")
        with stopped_thread(daemon.process.pid, "driver-base"):
            event = await listener.event("watchdog.stuck", active=True)
            assert event.source == "reader-of-base"
            fed, healths = manager.listen().count(FED), len(listener.healths)
            looks = int(WATCHDOG_S / 0.2)  # so many messages of health are long enough
            await until(
                lambda: len(listener.healths) > healths + looks, "the loop goes on"
            )
            assert manager.listen().count(FED) == fed
        await listener.event("watchdog.stuck", active=False)
        await until(lambda: manager.has(FED, fed + 1), "it is fed again")

        daemon.process.send_signal(signal.SIGABRT)  # as systemd does
        assert await daemon.ended() == -signal.SIGABRT
        assert "Fatal Python error: Aborted" in daemon.log
        assert "_serve" in daemon.log  # where the reader thread was


@pytest.mark.needs("mosquitto")
async def test_prometheus_reads_what_health_says(bench: Workbench) -> None:
    port = free_port()
    bench.write_simulator(REST)
    bench.write_daemon()
    add_tables(f"[metrics]\nport = {port}\n[realtime]\npriority = 1", bench)

    def scraped() -> str:
        with urllib.request.urlopen(f"http://{HOST}:{port}/metrics", timeout=20) as got:
            return str(got.read().decode())

    async with measuring(bench) as (listener, _, _):
        await until(lambda: listener.healths, "health")
        families = prometheus_reader.read(await asyncio.to_thread(scraped))
        samples = prometheus_reader.value(families, "traverse_samples_received_total")
        assert samples >= listener.healths[0].counters["samples_received"]
        info = {"arm": bench.arm, "version": listener.statuses[-1].version}
        kernel = listener.statuses[-1].kernel
        assert prometheus_reader.value(families, "traverse_info", **info, kernel=kernel)
        assert prometheus_reader.value(
            families, "traverse_device_state", device="base", state="ready"
        )
