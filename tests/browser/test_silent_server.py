import re
import signal

import pytest
from playwright.async_api import Page, expect

from tests.browser.conftest import PosedDaemon, ServePage
from traverse.protocol.messages import PointArgs

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]

# Two, or one where the browser knew already when the second was made.
ALL_ARE_LOST = (
    "[...window.traverse_watch.pending.values()].every(press => press.is_lost)"
)


def n_points(posed: PosedDaemon) -> int:
    return sum(isinstance(args, PointArgs) for args in posed.commands)


async def is_stale(page: Page) -> None:
    """Everything that the browser alone can show."""
    banner = page.locator("header")
    await expect(banner.locator(".silent-word")).to_have_text("Stale")
    await expect(banner.locator(".silent-banner")).to_be_visible()
    await expect(banner.locator(".said")).not_to_be_visible()
    await expect(banner).to_contain_text("Nothing has arrived from this page's server")
    style = await page.locator(".axis .value").first.evaluate(
        "value => [getComputedStyle(value).textDecorationLine, "
        "getComputedStyle(value).color]"
    )
    assert style[0] == "line-through"
    for name in ("Take point", "Mean of", "Undo", "Start scan", "New session"):
        button = page.get_by_role("button", name=name)
        await expect(button).to_have_attribute("aria-disabled", "true")


async def test_a_silent_arm_or_server_is_noticed_and_no_press_is_executed_later(
    posed: PosedDaemon, address: str, page_and_server: ServePage
) -> None:
    async with posed.posing(), page_and_server(posed.arm, address) as (page, server):
        take = page.get_by_role("button", name="Take point")
        await expect(page.locator(".said .word")).to_have_text("Ready")
        posed.is_stopped = True
        await expect(page.locator(".said .word")).to_have_text("Stale")
        await expect(page.locator(".figures")).to_have_class(re.compile("stale"))
        for name in ("Take point", "Undo", "New session"):
            await expect(page.get_by_role("button", name=name)).to_be_disabled()
        posed.is_stopped = False
        await expect(page.locator(".said .word")).to_have_text("Ready")
        await take.click()
        await expect(page.locator("tr.new")).to_have_count(1)
        assert n_points(posed) == 1
        bright = "getComputedStyle(document.querySelector('.axis .value')).color"
        colour = await page.evaluate(bright)

        # Two presses before anybody can know, two when the browser knows.
        # The browser knows after a second: the mouse's way would take that long.
        server.process.send_signal(signal.SIGSTOP)
        await take.evaluate("button => button.click()")
        await page.keyboard.press("Space")
        await is_stale(page)
        assert await page.evaluate(bright) != colour
        lost = page.locator(".press-outcome")
        await expect(lost).to_have_text(re.compile(r"^Lost: what was pressed at \d\d:"))
        await page.wait_for_function(ALL_ARE_LOST)  # each says so once, in its time
        await take.click(force=True)
        await expect(lost).to_have_text(re.compile(r"^Not sent at \d\d:\d\d:\d\d: "))
        await page.keyboard.press("Space")

        server.process.send_signal(signal.SIGCONT)
        await expect(page.locator(".said .word")).to_have_text("Ready")
        await expect(page.locator(".silent-banner")).not_to_be_visible()
        await expect(lost).to_have_text(re.compile(r"^Not carried out: .* s later\."))
        await expect(take).not_to_have_attribute("aria-disabled", "true")
        await take.click()  # all that came before has been judged by now
        await expect(page.locator("table.plain tr.new")).to_have_count(1)
        await expect(lost).to_have_text("")
        assert n_points(posed) == 2

        server.process.send_signal(signal.SIGKILL)
        await server.ended()
        await take.click(force=True)
        await expect(lost).to_have_text(re.compile(r"^(Lost|Not sent)"))
        await is_stale(page)
        assert n_points(posed) == 2
