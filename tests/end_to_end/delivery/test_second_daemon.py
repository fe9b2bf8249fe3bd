from pathlib import Path

import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, Workbench
from tests.mosquitto import Mosquitto
from traverse.daemon.mqtt.second_daemon import CODE, UNREAD
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")


@pytest.mark.slow
async def test_two_daemons_of_one_arm_are_reported(
    resting: Workbench, tmp_path: Path
) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    other = Workbench(folder, resting.host, resting.port, resting.arm)
    other.write_simulator(REST)
    other.write_daemon()
    async with measuring(resting) as (listener, _, first):
        with other.simulator() as simulator:
            await simulator.says("ready base")
            with other.daemon() as second:
                await until(
                    lambda: CODE in first.log and CODE in second.log, "both report it"
                )
                event = await listener.event(CODE, active=True)
                assert f"reports as arm {resting.arm}" in event.text
                assert "end one of the two" in event.remedy
                assert await second.stop() == 0
            assert await simulator.stop() == 0


@pytest.mark.slow
async def test_a_daemon_that_may_not_read_its_status_says_so(tmp_path: Path) -> None:
    acl = tmp_path / "old.acl"
    acl.write_text("topic write traverse/#\npattern read traverse/+/cmd/+\n", "utf-8")
    broker = Mosquitto(tmp_path, acl=acl)
    broker.start()
    try:
        bench = Workbench(tmp_path, broker.host, broker.port)
        bench.write_simulator(REST)
        bench.write_daemon()
        with bench.simulator() as simulator:
            await simulator.says("ready base")  # the daemon waits eight seconds for it
            with bench.daemon() as daemon:
                await daemon.says(UNREAD, 40.0)
                assert f"read and write traverse/{bench.arm}/status" in daemon.log
                assert await daemon.stop() == 0
            assert await simulator.stop() == 0
    finally:
        broker.stop()
