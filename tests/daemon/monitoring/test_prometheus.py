"""Figures as Prometheus reads them, and the endpoint that serves them."""

import asyncio
import re
import socket
from pathlib import Path

import pytest

from tests.daemon.monitoring.prometheus_reader import read, value
from tests.daemon.values import SetClock
from tests.mosquitto import free_port
from tests.protocol.message_examples import HEALTH
from tests.running import run_program
from traverse.daemon.config.schema import MetricsSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.monitoring.metrics_endpoint import (
    LIMIT_S,
    MAX_CLIENTS,
    MAX_REQUEST,
    MetricsEndpoint,
    metrics_endpoint,
)
from traverse.daemon.monitoring.prometheus import exposition, family

HOST = "127.0.0.1"
GET = b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"


def figures(health=HEALTH) -> str:
    handling = Latencies()
    for duration_ns in (5_000, 20_000, 3_000_000, 60_000_000_000):
        handling.add(duration_ns)
    latencies = {"handling": handling, "collection": Latencies()}
    conditions = {("reference", "base"): True, ("utc", "host"): False}
    return exposition(health, latencies, 12.5, '0.1 "beta"\\\n', conditions)


def test_every_figure_is_there_in_base_units():
    families = read(figures())
    assert value(
        families,
        "traverse_info",
        arm="bench-7",
        version='0.1 "beta"\\\n',
        kernel="numpy",
    )
    assert value(families, "traverse_uptime_seconds") == 3600.5
    assert value(families, "traverse_cpu_seconds_total") == 12.5
    assert value(families, "traverse_resident_memory_bytes") == 73_400_320
    assert value(families, "traverse_temperature_celsius", of="arm") == 20.5
    assert value(families, "traverse_skew_meters") == 4e-6
    assert value(families, "traverse_samples_received_total") == 3_600_000
    assert value(families, "traverse_points_captured_total") == 18
    assert value(families, "traverse_broker_state", state="connected") == 1
    assert value(families, "traverse_broker_state", state="lost") == 0
    assert value(families, "traverse_messages_unacknowledged") == 1
    outbox, recording = HEALTH.outbox, HEALTH.recording
    assert value(families, "traverse_outbox_points_unsent") == outbox.unsent
    assert value(families, "traverse_outbox_state", state=outbox.state) == 1
    assert value(families, "traverse_recording_state", state=recording.state) == 1
    assert value(families, "traverse_recording_dropped_total") == recording.dropped
    base = {"device": "base"}
    assert value(families, "traverse_device_state", **base, state="ready") == 1
    assert value(families, "traverse_device_silence_seconds", **base) == 0.001
    rejected = {"counter": "frames_rejected"}
    assert value(families, "traverse_device_counters_total", **base, **rejected) == 1


def test_latencies_are_histograms_since_the_start():
    families = read(figures())
    name = "traverse_latency_seconds"
    assert families[name].kind == "histogram"
    expected = {"1e-05": 1, "2e-05": 2, "0.002": 2, "0.005": 3, "5": 3, "+Inf": 4}
    for le, count in expected.items():
        assert value(families, f"{name}_bucket", of="handling", le=le) == count
    total_s = value(families, f"{name}_sum", of="handling")
    assert total_s == pytest.approx(60.003025)
    assert value(families, f"{name}_count", of="collection") == 0


def test_every_metric_is_explained_and_no_other():
    page = Path(__file__).parents[3] / "docs" / "reference" / "metrics.md"
    rows = re.findall(r"^\| `(traverse_\w+)` \| (\w+)", page.read_text("utf-8"), re.M)
    unsent = HEALTH.outbox.model_copy(update={"oldest_unsent_ns": HEALTH.time_ns - 1})
    families = read(figures(HEALTH.model_copy(update={"outbox": unsent})))
    of_counters = {f"traverse_{name}_total" for name in HEALTH.counters}
    kinds = {
        name: family.kind
        for name, family in families.items()
        if name not in of_counters
    }
    assert dict(rows) == kinds


def test_what_is_not_known_is_left_out():
    health = HEALTH.model_copy(update={"skew_mm": None, "temperatures_c": {}})
    families = read(figures(health))
    assert not {"traverse_skew_meters", "traverse_temperature_celsius"} & set(families)
    assert family("x", "nothing", []) == ""


@pytest.mark.needs("prometheus")
def test_promtool_finds_nothing_to_complain_of():
    done = run_program("promtool", "check", "metrics", input=figures())
    assert done.stdout + done.stderr == ""


@pytest.fixture
async def port():
    port, occurrences = free_port(), []
    section = MetricsSection(port=port)
    events = EventLog(SetClock(), occurrences.append)
    async with metrics_endpoint(section, figures, events):
        yield port
    assert occurrences == []


async def answer(port: int, request: bytes) -> bytes:
    """All that a client gets until the connection ends."""
    reader, writer = await asyncio.open_connection(HOST, port)
    try:
        writer.write(request)
        return await reader.read()
    except ConnectionError:
        return b""
    finally:
        writer.close()


async def served(port: int) -> bytes:
    """The figures, as soon as the endpoint has noticed that others disconnected."""
    got = b""
    async with asyncio.timeout(20):
        while b"200 OK" not in got:
            got = await answer(port, GET)
    return got


async def test_a_scrape_gets_the_figures(port):
    head, _, body = (await answer(port, GET)).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK\r\n")
    assert b"Content-Type: text/plain; version=0.0.4; charset=utf-8" in head
    assert f"Content-Length: {len(body)}".encode() in head
    assert body.decode() == figures()
    assert read(body.decode())


@pytest.mark.parametrize(
    ("request_line", "status"),
    [
        (b"GET / HTTP/1.1", b"404"),
        (b"GET /metrics/../etc/passwd HTTP/1.1", b"404"),
        (b"GET /metrics?x=1 HTTP/1.0", b"200"),
        (b"POST /metrics HTTP/1.1", b"405"),
        (b"GET /metrics", b"400"),
        (b"GET /metrics HTTP/2", b"400"),
        (b"\x16\x03\x01\x02\x00", b"400"),
        (b"", b"400"),
    ],
)
async def test_other_requests_are_refused(port, request_line, status):
    got = await answer(port, request_line + b"\r\nHost: x\r\n\r\n")
    assert got.split(b" ")[1] == status


async def test_head_gives_the_head_alone(port):
    got = await answer(port, GET.replace(b"GET", b"HEAD"))
    assert got.startswith(b"HTTP/1.1 200 OK\r\n")
    assert got.endswith(b"\r\n\r\n")


async def test_an_endless_request_is_cut(port):
    assert (
        await answer(port, b"GET /metrics HTTP/1.1\r\nX: " + MAX_REQUEST * b"x") == b""
    )


async def test_a_client_that_leaves_early_does_no_harm(port):
    for _ in range(20):
        _, writer = await asyncio.open_connection(HOST, port)
        writer.write(GET[:9])
        writer.close()
    assert await served(port)


async def test_so_many_clients_and_no_more_are_served_at_once(port):
    idle = [await asyncio.open_connection(HOST, port) for _ in range(MAX_CLIENTS)]
    assert await answer(port, GET) == b""
    for _, writer in idle:
        writer.close()
    for reader, _ in idle:
        assert await reader.read() == b""
    assert await served(port)


async def test_a_slow_client_is_cut(port, monkeypatch):
    monkeypatch.setattr("traverse.daemon.monitoring.metrics_endpoint.LIMIT_S", 0.05)
    assert LIMIT_S > 1
    assert await answer(port, GET[:10]) == b""


async def test_a_client_that_does_not_read_is_cut(monkeypatch):
    monkeypatch.setattr("traverse.daemon.monitoring.metrics_endpoint.LIMIT_S", 0.2)
    endpoint = MetricsEndpoint(lambda: "x" * 50_000_000)
    server = await asyncio.start_server(endpoint.serve, HOST, 0)
    port = server.sockets[0].getsockname()[1]
    with socket.create_connection((HOST, port)) as client:
        client.sendall(GET)
        async with asyncio.timeout(20):
            while endpoint._clients == 0:  # noqa: ASYNC110 - no event reports it
                await asyncio.sleep(0.005)
            while endpoint._clients:  # noqa: ASYNC110 - no event reports it
                await asyncio.sleep(0.005)
    server.close()
    await server.wait_closed()


async def test_figures_are_made_anew_when_they_are_old_only(monkeypatch):
    made = []

    def text() -> str:
        made.append(1)
        return "x 1\n"

    endpoint = MetricsEndpoint(text)
    monkeypatch.setattr("traverse.daemon.monitoring.metrics_endpoint.FRESH_S", 1000.0)
    for _ in range(50):
        endpoint._answer(GET)
    assert len(made) == 1
    monkeypatch.setattr("traverse.daemon.monitoring.metrics_endpoint.FRESH_S", 0.0)
    endpoint._answer(GET)
    assert len(made) == 2


async def test_a_port_that_is_taken_is_reported_and_does_not_stop_the_daemon():
    occurrences = []
    with socket.create_server((HOST, 0)) as other:
        port = other.getsockname()[1]
        events = EventLog(SetClock(), occurrences.append)
        async with metrics_endpoint(MetricsSection(port=port), figures, events):
            pass
    assert [(e.severity, e.code) for e in occurrences] == [
        ("warning", "metrics.refused")
    ]
    assert str(port) in occurrences[0].text


async def test_without_a_port_nothing_listens():
    async with metrics_endpoint(MetricsSection(), figures, EventLog(SetClock(), print)):
        assert MetricsSection().host == HOST
