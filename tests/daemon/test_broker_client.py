"""What aiomqtt's client does not do for us by itself."""

import asyncio

import aiomqtt
import pytest

from daemon.broker_client import BrokerClient


async def test_a_cancellation_as_the_work_ends_is_not_forgotten():
    work = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(BrokerClient("nowhere")._wait_for(work, None))
    await asyncio.sleep(0)
    work.set_result("done")
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting


async def test_work_that_takes_too_long_is_given_up():
    work = asyncio.get_running_loop().create_future()
    with pytest.raises(aiomqtt.MqttError, match="timed out"):
        await BrokerClient("nowhere")._wait_for(work, 0.01)
    assert work.cancelled()
