import pytest
from playwright.async_api import Page, expect

from tests.browser.conftest import OpenPage, PosedDaemon, hears_server
from traverse.protocol.messages import Label

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]


async def choose(page: Page, *answers: str) -> None:
    for answer in answers:
        await page.locator(".setup button").last.click()
        await page.get_by_role("dialog").get_by_role("button", name=answer).click()
        await expect(page.get_by_role("dialog")).to_have_count(0)


@pytest.mark.slow
async def test_a_german_browser_shows_a_german_page_without_english_rests(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    posed.pose["xyz_mm"] = [13.0, 24.0, 30.0]
    async with posed.posing(), served_page(posed.arm, address, locale="de-DE") as page:
        await expect(page.locator("header .word")).to_have_text("Bereit")
        await expect(page.locator("header .said .sentence")).to_have_text(
            "Bereit zum Messen."
        )
        # Names stay, even where they are words of the page.
        await posed.touch(10.0, 20.0, 30.0, label=Label(artefact="Part"))
        row = page.locator("table.plain tbody tr").first
        await expect(row).to_contain_text("Part")
        await expect(page.get_by_text("from point 0")).to_have_count(0)
        await expect(page.locator(".step")).to_contain_text("von Punkt 0")
        system = page.locator(".figures .system")
        await expect(system).to_have_text("Kugelmitte, System des Arms")
        title = page.locator(".points h2")
        await expect(title).to_have_text("Punkte: 1, System des Arms")
        await expect(page.locator("html")).to_have_attribute("lang", "de")
        part = page.locator(".part")
        for key in ("n", "l"):
            await page.keyboard.press(key)
            await expect(page.get_by_role("dialog")).to_be_visible()
            await page.keyboard.press("Escape")
            await expect(page.get_by_role("dialog")).to_have_count(0)
        await part.get_by_role("button", name="Kreis").click()
        asks = part.locator(".asks")
        await expect(asks).to_contain_text("Rundum gleichmäßig berühren.")
        for xyz_mm in ((5.0, 0.0, 0.0), (0.0, 5.0, 0.0), (-5.0, 0.0, 0.0)):
            await posed.touch(*xyz_mm)
        await expect(asks).to_contain_text("3 Berührungen; mindestens 3, gut sind 7.")
        await part.get_by_role("button", name="Annehmen").click()
        await page.get_by_role("button", name="Prüfkugel").click()
        await expect(page.locator(".instruction")).to_contain_text("noch 9")
        await page.keyboard.press("s")
        missing = await page.evaluate("[...traverse_language.missing]")
        assert "\n".join(missing) == ""

        # A chosen language and the comma apply without a reload, and are remembered.
        value = page.locator(".axis .value").first
        await expect(value).to_have_text("13.000")
        await choose(page, "中文", "小数逗号")
        await expect(page.locator("header .word")).to_have_text("就绪")
        await expect(value).to_have_text("13,000")
        await page.reload()
        await hears_server(page)
        await expect(page.locator("header .word")).to_have_text("就绪")
        await expect(value).to_have_text("13,000")
        await choose(page, "English", "Decimal point")
        await expect(page.locator("header .word")).to_have_text("Ready")
        await expect(value).to_have_text("13.000")
