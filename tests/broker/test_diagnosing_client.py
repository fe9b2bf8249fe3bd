"""A visitor of brokers that do not do what brokers do."""

import asyncio
import contextlib

import aiomqtt
import pytest

from traverse.broker.diagnosing_client import ConnectionClosedError, DiagnosingClient

HOST = "127.0.0.1"


@contextlib.asynccontextmanager
async def door(meet):
    """Start a listener; return the port."""
    server = await asyncio.start_server(meet, HOST, 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


async def test_an_end_without_an_answer_is_reported_at_once():
    async def close(reader, writer):
        await reader.read(1)
        writer.close()

    async with door(close) as port:
        with pytest.raises(ConnectionClosedError):
            await DiagnosingClient(HOST, port).__aenter__()


async def test_who_does_not_wait_for_the_answer_leaves():
    came, left = asyncio.Event(), asyncio.Event()

    async def be_silent(reader, writer):
        await reader.readexactly(1)
        came.set()
        await reader.read()  # up to the end
        left.set()
        writer.close()

    async with door(be_silent) as port:
        visit = asyncio.create_task(DiagnosingClient(HOST, port).__aenter__())
        await came.wait()
        visit.cancel()
        with pytest.raises(asyncio.CancelledError):
            await visit
        async with asyncio.timeout(10):
            await left.wait()


async def test_a_cancellation_as_the_work_ends_is_not_forgotten():
    work = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(DiagnosingClient("nowhere")._wait_for(work, None))
    await asyncio.sleep(0)
    work.set_result("done")
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting


async def test_work_that_takes_too_long_is_given_up():
    work = asyncio.get_running_loop().create_future()
    with pytest.raises(aiomqtt.MqttError, match="timed out"):
        await DiagnosingClient("nowhere")._wait_for(work, 0.01)
    assert work.cancelled()
