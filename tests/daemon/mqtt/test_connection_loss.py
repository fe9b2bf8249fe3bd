"""A broker that disconnects, refuses, or vanishes silently."""

import asyncio
import sys

import aiomqtt
import pytest

from tests.daemon.mqtt.connection_harness import STATUS, Bench, Witness, address
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


async def test_the_will_is_published_when_the_process_vanishes(mosquitto):
    async with Witness(mosquitto.port, STATUS) as witness:
        program = (
            "import asyncio, sys; from tests.daemon.mqtt.connection_harness import *\n"
            "async def main():\n"
            "    async with Bench(BrokerAddress('127.0.0.1', int(sys.argv[1])))"
            ".running():\n"
            "        print('connected', flush=True)\n"
            "        await asyncio.sleep(60)\n"
            "asyncio.run(main())\n"
        )
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", program, str(mosquitto.port)),
            stdout=asyncio.subprocess.PIPE,
        )
        try:
            assert await process.stdout.readline() == b"connected\n"
        finally:
            process.kill()
            await process.communicate()
        await until(lambda: b"gone" in [m.payload for m in witness.messages], "will")


async def test_an_orderly_end_publishes_no_will(mosquitto):
    async with Witness(mosquitto.port, f"{STATUS}/#") as witness:
        before = len(witness.messages)
        async with Bench(address(mosquitto)).running() as bench:
            bench.queue.offer(
                "status", OutgoingMessage(STATUS, b"bye", qos=1, retain=True)
            )
            await until(lambda: not bench.queue.waiting("status"), "the status")
        await until(
            lambda: b"bye" in [m.payload for m in witness.messages], "the last word"
        )
        async with Bench(address(mosquitto)).running():
            pass  # by now the broker has dealt with the first one's end
    assert b"gone" not in [m.payload for m in witness.messages[before + 1 :]]


async def test_points_of_an_outage_are_delivered_once_each_in_order(make_mosquitto):
    broker = make_mosquitto()
    async with Bench(address(broker)).running() as bench:
        bench.point("0")
        await bench.all_sent()
        broker.kill()
        await until(lambda: bench.publisher.state == "lost", "the loss")
        for k in range(1, 30):
            bench.point(str(k))
        assert bench.queue.waiting("point") == 29
        broker.start()
        async with Witness(broker.port, "traverse/bench-7/point") as witness:
            await bench.all_sent()
            arrived = [int(message.payload) for message in witness.messages]
        assert bench.publisher.reconnects == 1
    # The witness connected while they were sent; what it received was in order.
    assert arrived == list(range(min(arrived, default=0), 30))[: len(arrived)]
    assert bench.queue.sent["point"] == 30
    assert [up for up, _ in bench.changes] == [True, False, True]


async def test_a_session_of_the_witness_sees_every_point_of_an_outage_once(
    make_mosquitto,
):
    broker = make_mosquitto()
    async with Bench(address(broker)).running() as bench:
        broker.stop()
        await until(lambda: bench.publisher.state == "lost", "the loss")
        seen = []
        task = asyncio.create_task(first_come(broker.port, seen))
        for k in range(20):
            bench.point(str(k))
        # The publisher waits 0.1 s at least between tries, the witness 1 ms.
        broker.start()
        await bench.all_sent()
        await until(lambda: len(seen) >= 20 or task.done(), "20 points")
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    assert seen[-1] == b"19"
    assert seen == sorted(set(seen), key=int)


async def first_come(port: int, seen: list[bytes]) -> None:
    while True:
        try:
            async with aiomqtt.Client("127.0.0.1", port) as client:
                await client.subscribe("traverse/bench-7/point", qos=1)
                async for message in client.messages:
                    seen.append(message.payload)  # noqa: PERF401 - it never ends
        except aiomqtt.MqttError:
            await asyncio.sleep(0.001)


async def test_a_point_that_the_broker_refuses_is_kept_and_told(make_mosquitto, caplog):
    broker = make_mosquitto()
    broker.stop()
    broker.allow_writing(STATUS)
    broker.start()
    async with Bench(address(broker)).running() as bench:
        refusals = []
        block = OutgoingMessage(
            "not/mine", b"", 1, refused=lambda: refusals.append("block")
        )
        bench.queue.offer("spooled", block)
        bench.queue.offer("reply", OutgoingMessage("not/mine", b"", qos=1))
        bench.point("0")
        await until(lambda: len(caplog.messages) == 2, "the refusals")
        # The event of the first kind lasts, and is logged by whoever reports it; the
        # reply's and the later one are logged.
        (up, _), (still_up, refusal) = bench.changes
        assert (up, still_up) == (True, False)
        refused = sorted([refusal, *caplog.messages])
        for text, topic in zip(
            refused, ("not/mine", "not/mine", "traverse/bench-7/point"), strict=True
        ):
            assert f"refuses {topic}" in text
        assert bench.queue.waiting("point") == 1
        assert bench.queue.sent["point"] == 0
        assert bench.queue.dropped["reply"] == 1
        await until(lambda: refusals, "the block's refusal")
        assert (bench.queue.waiting("spooled"), bench.queue.dropped["spooled"]) == (
            0,
            0,
        )
        broker.stop()
        broker.allow_writing("#")
        broker.start()
        await bench.all_sent()
        await until(lambda: bench.queue.sent["point"], "the point")
