"""Points typed into a program under a real X server; keys that must not be."""

import asyncio
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.client.gateways.desktop import Desktop, desktop
from tests.client.reading import PATIENCE_S
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import POINT, STATUS
from traverse.client import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.gateways import keys
from traverse.client.gateways.keys import (
    KeyboardGoneError,
    KeysOutlet,
    UinputKeyboard,
    keys_template,
)
from traverse.client.gateways.lines import LineForm, LineGateway
from traverse.protocol.messages.quality import Quality
from traverse.testing.waiting import until

GOOD = {"quality": Quality.from_bits(0)}
on_a_desktop = pytest.mark.needs("mosquitto", "xvfb")


@pytest.fixture
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Desktop]:
    with desktop(tmp_path) as display:
        monkeypatch.setenv("DISPLAY", display.name)
        yield display


class Typing:
    def __init__(self, virtual: VirtualDaemon, arm: Arm) -> None:
        self._virtual = virtual
        self.arm = arm
        self.reports: list[str] = []
        self._seq = 0

    async def take(self, **values: Any) -> None:
        """Take a good point, but for these values."""
        place = {"session": self._virtual.session, "seq": self._seq}
        named = {**place, "arm": self._virtual.arm, "id": f"p{self._seq}"}
        self._seq += 1
        await self._virtual.publish(POINT.model_copy(update=GOOD | named | values))

    async def say(self, **values: Any) -> None:
        named = {"arm": self._virtual.arm, "session": self._virtual.session}
        await self._virtual.publish(STATUS.model_copy(update=named | values))
        async with asyncio.timeout(PATIENCE_S):
            while not values.items() <= vars(await self.arm.status()).items():  # noqa: ASYNC110
                await asyncio.sleep(0.01)


def gateway(arm: Arm, reports: list[str], template: str, decimal: str) -> LineGateway:
    form = LineForm(template, None, "centre", "mm", decimal, sends_doubtful=False)
    return LineGateway(
        form, KeysOutlet(arm, "desktop", "f9", reports.append), reports.append
    )


ALARM = STATUS.alarms[0]


@on_a_desktop
async def test_points_are_typed_unless_arm_or_operator_forbid_it(
    virtual: VirtualDaemon, broker: str, shown: Desktop, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        typing = Typing(virtual, arm)
        reports = typing.reports
        sender = gateway(arm, reports, keys_template("tab", "enter"), ",")
        async with sender.outlet:
            assert sender.outlet.name == "the desktop's keyboard (f9 stops it)"
            task = asyncio.create_task(sender.send_points(arm))
            await typing.say(alarms=(), online=True, state="ready")
            await typing.take()
            line = "612,2500\t-80,5000\t301,1250\n"
            await until(lambda: shown.typed == line)

            await typing.take(quality=Quality.from_bits(1))
            await until(lambda: sender.counts.held_back == 1)
            assert (
                reports[-1] == "1 point not sent: point 1 is in doubt (encoder_error)"
            )

            alarm = ALARM.model_copy(update={"severity": "warning"})
            await typing.say(alarms=(alarm,))
            await typing.take()
            await until(lambda: sender.counts.held_back == 2)
            assert f"point 2: alarm {alarm.code}: {alarm.text}" in reports[-1]
            await typing.say(alarms=(alarm.model_copy(update={"severity": "info"}),))
            await typing.take()
            await until(lambda: shown.typed == 2 * line)
            await typing.say(alarms=(), online=False, state="offline")
            await typing.take()
            await until(lambda: sender.counts.held_back == 3)
            await typing.say(alarms=(), online=True, state="ready")

            shown.press("F9")
            await until(lambda: reports[-1].startswith("typing is stopped"))
            await typing.take()
            await until(lambda: sender.counts.held_back == 4)
            shown.press("F9")
            await until(lambda: reports[-1].startswith("typing goes on"))
            monkeypatch.setattr(keys, "KEY_S", 0.2)  # the key is pressed in between
            await typing.take()
            await until(lambda: len(shown.typed) > 2 * len(line) + 2)
            shown.press("F9")
            await until(lambda: sender.counts.held_back == 5)
            assert re.search(r"stopped by f9; \d+ of 27 keys are typed", reports[-1])
            await cancel_tasks([task])
        assert sender.counts.sent == 2
        assert 2 * line == shown.typed[: 2 * len(line)]
        assert line.startswith(shown.typed[2 * len(line) :])


@on_a_desktop
async def test_a_desktop_that_ends_ends_the_gateway_in_a_sentence(
    virtual: VirtualDaemon, broker: str, shown: Desktop
) -> None:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        typing = Typing(virtual, arm)
        sender = gateway(arm, typing.reports, keys_template("space", "tab"), ".")
        async with sender.outlet:
            task = asyncio.create_task(sender.send_points(arm))
            await typing.say(alarms=(), online=True, state="ready")
            await typing.take()
            await until(lambda: shown.typed == "612.2500 -80.5000 301.1250\t")
            shown.server.kill()
            await asyncio.to_thread(shown.server.wait)
            await typing.take()
            with pytest.raises(KeyboardGoneError, match="the desktop"):
                async with asyncio.timeout(PATIENCE_S):
                    await task


def test_a_computer_without_uinput_says_what_to_do(tmp_path: Path) -> None:
    missing = tmp_path / "uinput"
    with pytest.raises(ValueError, match=r"does not exist: .*try sudo modprobe uinput"):
        UinputKeyboard("f9", print, str(missing))
