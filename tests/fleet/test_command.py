"""`traverse store` as a user runs it: beside another, and with an arm that forgets."""

import pytest

from tests.client.virtual_daemon import VirtualDaemon
from tests.fleet.running import becomes, rows, started
from tests.protocol.message_examples import SCAN

pytestmark = pytest.mark.needs("mosquitto")


async def test_the_first_command_works_without_a_server(mosquitto, tmp_path):
    arm = VirtualDaemon(f"arm-{tmp_path.name}", mosquitto.host, mosquitto.port)
    select = f"SELECT count(*) FROM point WHERE arm = '{arm.arm}'"
    async with started(tmp_path, mosquitto, "--group", tmp_path.name[:40]) as member:
        await member.says("connected to")
        async with arm.running():
            await arm.take(20)
            arm.is_mute = True
            await arm.take(5)  # nobody heard them
            arm.is_mute = False
            await arm.publish(SCAN.model_copy(update={"arm": arm.arm}))
            await becomes(tmp_path, select, [(25,)])
            # It loses points that the store does not have yet.
            arm.is_mute = True
            await arm.take(6)
            arm.forget(arm.session, 28)
            arm.is_mute = False
            await member.says("25 to 27 are lost: the arm does not have them any more")
            await becomes(tmp_path, select, [(28,)])
        assert await member.stop() == 0
    assert "0 dropped" in member.lines[-1]
    lost = f"SELECT from_seq, to_seq FROM lost WHERE arm = '{arm.arm}' AND scan = ''"
    assert rows(tmp_path, lost) == [(25, 27)]
    files = f"SELECT file FROM scan_block WHERE arm = '{arm.arm}'"
    for (file,) in rows(tmp_path, files):
        assert (tmp_path / "traverse-scans" / file).is_file()


async def test_a_scan_that_an_arm_never_sends_again_holds_up_no_points(
    mosquitto, tmp_path
):
    arm = VirtualDaemon(f"arm-{tmp_path.name}", mosquitto.host, mosquitto.port)
    begun = {"session": "s", "begun_ns": "1"}  # before all points
    arm.scans = ({"scan": "early", "last_block_seq": 9, **begun},)
    select = f"SELECT count(*) FROM point WHERE arm = '{arm.arm}'"
    async with started(tmp_path, mosquitto, "--group", tmp_path.name[:40]) as member:
        await member.says("connected to")
        async with arm.running():
            arm.is_mute = True
            await arm.take(3)
            arm.is_mute = False
            await becomes(tmp_path, select, [(3,)])
        assert await member.stop() == 0


async def test_a_broker_that_is_not_there_is_told(make_mosquitto, tmp_path):
    broker = make_mosquitto()
    broker.stop()
    async with started(tmp_path, broker) as member:
        await member.says("; tries again")
        broker.start()
        await member.says("connected to")
        assert await member.stop() == 0


async def test_a_second_member_of_one_name_is_refused(mosquitto, tmp_path):
    words = ("--group", tmp_path.name[:40], "--member", "one")
    async with started(tmp_path, mosquitto, *words) as first:
        await first.says("connected to")
        async with started(tmp_path, mosquitto, *words) as second:
            assert await second.ended() == 2
        assert "is called one; give each a --member of its own" in second.lines[-1]
        assert "connected to" not in " ".join(second.lines)  # of the first
        assert await first.stop() == 0
    async with started(tmp_path, mosquitto, *words) as third:
        await third.says("connected to")  # at once: it is free again
        assert "waiting" not in " ".join(third.lines)
        assert await third.stop() == 0


async def test_what_cannot_be_is_refused(mosquitto, tmp_path):
    for words, expected in (
        (("--group", "a/b"), "--group 'a/b': expected 1 to 40 letters"),
        (("--database", "mysql://host/x"), "mysql://: no such database"),
        (("--scans", "nonsense://x"), "expected a folder or a URI"),
    ):
        async with started(tmp_path, mosquitto, *words) as member:
            assert await member.ended() == 2
        assert expected in " ".join(member.lines)
        assert "Traceback" not in " ".join(member.lines)
