import asyncio
import json
import signal
from typing import Any

import aiomqtt
import msgpack
import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import PATIENCE_S
from tests.end_to_end.workbench import REST, SPHERE, Workbench
from traverse.protocol.messages import ScanArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


async def raw(bench: Workbench, kinds: set[str]) -> dict[str, aiomqtt.Message]:
    by_kind: dict[str, aiomqtt.Message] = {}
    async with (
        aiomqtt.Client(
            bench.host, bench.port, protocol=aiomqtt.ProtocolVersion.V5
        ) as client,
        asyncio.timeout(PATIENCE_S),
    ):
        await client.subscribe(f"traverse/{bench.arm}/#", qos=1)
        async for message in client.messages:
            by_kind.setdefault(str(message.topic).split("/")[2], message)
            if kinds <= by_kind.keys():
                break
    return by_kind


def as_map(message: aiomqtt.Message, encoding: str) -> dict[str, Any]:
    """The payload as plain values, with nothing of ours."""
    assert isinstance(message.payload, bytes)
    assert message.properties is not None
    assert message.properties.ContentType == f"application/{encoding}"
    values = (
        json.loads(message.payload)
        if encoding == "json"
        else msgpack.unpackb(message.payload)
    )
    assert isinstance(values, dict)
    return values


async def test_every_payload_is_in_the_configured_encoding(bench: Workbench) -> None:
    bench.write_simulator(SPHERE.format(points=2), top="repeat = true")
    bench.write_daemon(broker='encoding = "msgpack"')
    kinds = {"status", "health", "live", "point", "scan", "event"}
    async with measuring(bench) as (listener, _, _), asyncio.TaskGroup() as tasks:
        looking = tasks.create_task(raw(bench, kinds))
        await listener.command(ScanArgs(action="start", rate_hz=100.0))
        await looking
    maps = {kind: as_map(looking.result()[kind], "msgpack") for kind in kinds}
    for kind, values in maps.items():
        assert values["schema"] == f"traverse/{kind}/1"
        assert values["arm"] == bench.arm
    time_ns = maps["point"]["time_ns"]
    assert time_ns > 1_700_000_000_000_000_000
    assert listener.points
    assert listener.scans


async def test_status_health_and_clock_are_retained_and_nothing_else(
    bench: Workbench,
) -> None:
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        await until(lambda: listener.healths, "health")
        by_kind = await raw(bench, {"status", "health", "clock", "live"})
    assert by_kind["status"].retain
    assert by_kind["clock"].retain
    assert by_kind["health"].retain
    assert not by_kind["live"].retain
    last = (await raw(bench, {"status"}))["status"]
    values = as_map(last, "msgpack")
    assert (values["online"], values["state"]) == (False, "offline")


async def test_the_last_will_says_offline_when_the_daemon_is_killed(
    bench: Workbench,
) -> None:
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, daemon):
        online = listener.statuses[-1]
        daemon.process.send_signal(signal.SIGKILL)
        assert await daemon.ended() == -signal.SIGKILL
        await until(lambda: not listener.statuses[-1].online, "offline by last will")
        assert listener.statuses[-1].session == online.session
        with bench.daemon(name="daemon-again") as repeated:
            await listener.ready()
            assert listener.statuses[-1].session != online.session
            assert await repeated.stop() == 0
