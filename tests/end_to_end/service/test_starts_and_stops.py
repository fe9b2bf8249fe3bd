"""The daemon starts, refuses to start, and ends; exit statuses and output."""

import asyncio
import os
import signal
from pathlib import Path

import pytest

from tests.end_to_end.listener import listening
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, Workbench
from tests.mosquitto import HOST, free_port
from traverse.testing.waiting import until

REFUSED, UNREACHABLE = 2, 3


@pytest.fixture
def unconnected(tmp_path: Path) -> Workbench:
    bench = Workbench(tmp_path, HOST, free_port())
    bench.write_simulator(REST)
    bench.write_daemon()
    return bench


async def test_no_port_and_no_broker_are_told_together(unconnected: Workbench) -> None:
    with unconnected.daemon() as daemon:
        assert await daemon.ended() == UNREACHABLE
        assert "traverse cannot start:" in daemon.log
        failures = [x for x in daemon.log.splitlines() if x.startswith("  - ")]
        assert len(failures) == 2
        assert str(unconnected.pty) in failures[0]
        assert "no such port" in failures[0]
        assert "device base" in failures[0]
        assert (
            f"{unconnected.host}:{unconnected.port}: nothing listens there"
            in failures[1]
        )
        assert "Traceback" not in daemon.log
        assert daemon.output == ""


async def test_a_bad_arm_file_and_a_missing_broker_table_are_told_together(
    unconnected: Workbench,
) -> None:
    unconnected.change("arm.toml", "axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 0.0]")
    unconnected.change("arm.toml", "sign = -1", "sign = 2")
    unconnected.port = 0
    unconnected.write_daemon()
    with unconnected.daemon() as daemon:
        assert await daemon.ended() == REFUSED
        for where in ("broker", "joints[0].axis", "joints[1].encoder.sign"):
            assert f"{where}: " in daemon.log
        assert "--embedded-broker" in daemon.log
        assert "Traceback" not in daemon.log


async def test_an_arm_that_does_not_fit_the_board_is_refused(
    unconnected: Workbench,
) -> None:
    with unconnected.simulator() as simulator:
        await simulator.says("ready base")
        unconnected.change(
            "arm.toml", "counts_per_turn = 8388608", "counts_per_turn = 8388607"
        )
        unconnected.change("arm.toml", '"base/6"', '"base/9"')
        with unconnected.daemon() as daemon:
            assert await daemon.ended() == REFUSED
            for expected in (
                "8388607",
                "channel 9",
                f"{unconnected.host}:{unconnected.port}",
            ):
                assert expected in daemon.log
        assert await simulator.stop() == 0


@pytest.mark.needs("mosquitto")
async def test_a_second_daemon_says_so_and_leaves_the_first_in_peace(
    bench: Workbench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, first):
        monkeypatch.setenv("STATE_DIRECTORY", str(bench.folder / "other"))
        with bench.daemon(name="second") as second:
            assert await second.ended() == UNREACHABLE
            assert f"cannot open {bench.pty}: in use by another program" in second.log
        n_before = len(listener.healths)
        await until(lambda: len(listener.healths) > n_before + 1, "more figures")
        assert listener.healths[-1].counters["reconnects"] == 0
        assert all(status.online for status in listener.statuses)
        assert first.process.poll() is None
        assert listener.events_of("device.lost", active=True) == []


async def test_a_signal_ends_it_while_it_waits_for_a_mute_board(
    unconnected: Workbench,
) -> None:
    board, line = os.openpty()
    try:
        unconnected.pty.symlink_to(os.ttyname(line))
        unconnected.write_daemon()
        with unconnected.daemon() as daemon:
            await asyncio.to_thread(os.read, board, 1)  # it sends HELLO, unanswered
            daemon.process.send_signal(signal.SIGTERM)
            # Before it abandons the board: the devices may take eight seconds.
            assert await daemon.ended(timeout_s=5.0) == 0
    finally:
        os.close(board)
        os.close(line)


@pytest.mark.needs("mosquitto")
async def test_ctrl_c_ends_the_daemon_in_order(bench: Workbench) -> None:
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, daemon):
        assert await daemon.stop(signal.SIGINT) == 0
        assert "Traceback" not in daemon.log
        await until(lambda: not listener.statuses[-1].online, "its last status")


async def test_the_daemon_brings_its_own_broker(unconnected: Workbench) -> None:
    port = str(unconnected.port)
    unconnected.port = 0
    unconnected.write_daemon()
    with unconnected.simulator() as simulator:
        await simulator.says("ready base")
        with unconnected.daemon("--embedded-broker", "--embedded-port", port) as daemon:
            await daemon.says("model ")
            async with listening(HOST, int(port), unconnected.arm) as listener:
                await listener.ready()
            assert await daemon.stop() == 0
            assert "Traceback" not in daemon.log
        assert await simulator.stop() == 0
