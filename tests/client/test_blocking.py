import asyncio
import threading
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest

from tests.client.virtual_daemon import VirtualDaemon
from tests.mosquitto import free_port
from tests.protocol.message_examples import EVENT, LIVE, SCAN
from traverse.client import BlockingArm, BrokerUnreachableError, CommandRefused, Lost

pytestmark = pytest.mark.needs("mosquitto")
QUIET_S = 20.0
Do = Callable[[Coroutine[Any, Any, Any]], Any]


@pytest.fixture
def elsewhere(virtual: VirtualDaemon) -> Iterator[Do]:
    """The daemon, running in another thread; runs functions there."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    def do(work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, loop).result(QUIET_S)

    life = virtual.running()
    do(life.__aenter__())
    yield do
    do(life.__aexit__(None, None, None))
    do(loop.shutdown_default_executor())
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def test_points_are_captured_and_read(
    virtual: VirtualDaemon, broker: str, elsewhere: Do
) -> None:
    with BlockingArm(virtual.arm, broker) as arm:
        first = arm.capture()
        undone = arm.undo()
        assert list(arm.points(idle_timeout_s=0.05)) == [first, undone]
        third = arm.capture()
        assert next(arm.points(idle_timeout_s=QUIET_S)) == third
        assert arm.cursor == {virtual.session: 2}  # the third is in hand yet
        assert arm.counters.lost == 0
        assert arm.is_connected
        assert arm.status().session == virtual.session
    with pytest.raises(RuntimeError, match="with"):
        arm.capture()


def test_losses_are_among_the_points_if_wanted(
    virtual: VirtualDaemon, broker: str, elsewhere: Do
) -> None:
    elsewhere(virtual.take(4))
    virtual.forget(virtual.session, 3)
    with BlockingArm(virtual.arm, broker, since="beginning") as arm:
        lost, point = (next(arm.points_and_losses(QUIET_S)) for _ in range(2))
        assert isinstance(lost, Lost)
        assert (lost.from_seq, lost.to_seq) == (0, 2)
        assert [point] == virtual.points


def test_every_command_can_be_given(
    virtual: VirtualDaemon, broker: str, elsewhere: Do
) -> None:
    with BlockingArm(virtual.arm, broker) as arm:
        arm.label("ball", "1")
        arm.probe("ruby-3")
        arm.reload()
        arm.align(((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0, 0, 0))
        arm.clear_alignment()
        session = arm.new_session()
        assert arm.sessions()[-1].session == session
        assert arm.resend(session).points == 0
        names = [type(args).__name__ for args in virtual.commands]
        expected = ["LabelArgs", "ProbeArgs", "ReloadArgs", "AlignArgs", "AlignArgs"]
        assert [name for name in names if name != "ResendArgs"] == [
            *expected,
            "SessionArgs",
        ]
        virtual.can_resend = False
        with pytest.raises(CommandRefused):
            arm.sessions()


def test_events_live_poses_and_scans_can_be_iterated(
    virtual: VirtualDaemon, broker: str, elsewhere: Do
) -> None:
    with BlockingArm(virtual.arm, broker) as arm:
        events = arm.events(QUIET_S)
        elsewhere(virtual.publish(EVENT))
        assert next(events) == EVENT
        poses = arm.live(0.1)
        live = None
        while live is None:  # until subscribed
            elsewhere(virtual.publish(LIVE))
            live = next(poses, None)
        assert live == LIVE
        with arm.scan(rate_hz=100.0, idle_timeout_s=QUIET_S) as blocks:
            block = SCAN.model_copy(update={"seq": 0, "last": True, "total": 3})
            elsewhere(virtual.publish(block))
            assert list(blocks) == [block]


def test_a_broker_that_is_not_there_is_reported_and_no_thread_is_left() -> None:
    arm = BlockingArm("bench-7", f"localhost:{free_port()}", connect_timeout_s=0.1)
    with pytest.raises(BrokerUnreachableError), arm:
        pass
