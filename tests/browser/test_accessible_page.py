from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Page, expect

from tests.browser.conftest import OpenPage, PosedDaemon, change_theme, settled
from tests.client.display.values import health
from tests.interface.conftest import node_modules

__all__ = ["node_modules"]  # a fixture

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]
GRAVE = ("critical", "serious", "moderate")
SIZES = DESK, TABLET, PHONE = (1600, 900), (820, 1180), (390, 844)


async def findings(page: Page, axe: Path, within: str = "html") -> list[Any]:
    """Findings of axe-core that are grave: rule, impact, and where."""
    if not await page.evaluate("'axe' in window"):
        await page.add_script_tag(path=axe)
    # The framework's bar of a running request, which is there for a moment.
    context = {"include": [within], "exclude": ["#q-loading-bar"]}
    results = await page.evaluate("context => axe.run(context)", context)
    return [
        (rule["id"], rule["impact"], [node["html"][:80] for node in rule["nodes"]])
        for rule in results["violations"]
        if rule["impact"] in GRAVE
    ]


@pytest.mark.slow
async def test_axe_finds_nothing_grave(
    posed: PosedDaemon, address: str, served_page: OpenPage, node_modules: Path
) -> None:
    axe = node_modules / "axe-core" / "axe.min.js"
    async with posed.posing(), served_page(posed.arm, address) as page:
        await expect(page.locator(".word")).to_have_text("Ready")
        await posed.publish(health(arm=posed.arm))
        await posed.take(3)
        await page.get_by_role("button", name="Plane", exact=True).click()
        await posed.touch(1.0, 2.0, 3.0)
        await expect(page.locator(".part .touches button")).to_have_count(1)
        for width, height in (*SIZES, DESK):  # in the themes by turns
            await page.set_viewport_size({"width": width, "height": height})
            await settled(page)
            assert not (grave := await findings(page, axe)), (width, grave)
            await change_theme(page)
        await page.get_by_role("button", name="About").click()
        await expect(page.get_by_role("dialog")).to_be_visible()
        for width, height in (DESK, PHONE):
            await page.set_viewport_size({"width": width, "height": height})
            await settled(page)
            grave = await findings(page, axe, "[role=dialog]")
            assert not grave, (width, grave)


async def test_the_report_sheet_has_nothing_grave(
    posed: PosedDaemon, address: str, served_page: OpenPage, node_modules: Path
) -> None:
    async with posed.posing(), served_page(posed.arm, address) as page:
        await page.get_by_role("button", name="Plane", exact=True).click()
        for x, y in ((0, 0), (50, 0), (0, 50)):
            await posed.touch(float(x), float(y), 3.0)
        await expect(page.locator(".part .touches button")).to_have_count(3)
        await page.goto(page.url + "report")
        await expect(page.get_by_role("heading", level=1)).to_have_count(1)
        axe = node_modules / "axe-core" / "axe.min.js"
        assert not (grave := await findings(page, axe)), grave
