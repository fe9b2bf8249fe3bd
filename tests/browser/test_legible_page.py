"""The page can be read at the arm: contrast, sizes on touch screens, order."""

import pytest
from playwright.async_api import Page, expect

from tests.browser.conftest import OpenPage, PosedDaemon, change_theme
from tests.client.display.values import event, health

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]

# Contrast of every piece of text with what is behind it, below 4.5:1.
FAINT = """() => {
  const parse = text => {
    const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number);
    return {rgb: [r, g, b], a};
  };
  const luminance = rgb => {
    const [r, g, b] = rgb.map(c => c / 255).map(
      c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = element => {
    for (let e = element; e; e = e.parentElement) {
      const {rgb, a} = parse(getComputedStyle(e).backgroundColor);
      if (a === 1) return rgb;
    }
    return [255, 255, 255];
  };
  const faint = [];
  for (const element of document.querySelectorAll("main *")) {
    const own = [...element.childNodes].some(n => n.nodeType === 3 && n.data.trim());
    const style = getComputedStyle(element);
    const disabled = element.closest("[disabled], .disabled, [aria-hidden=true]");
    const shown = element.checkVisibility({opacityProperty: true});
    if (!own || !shown || disabled) continue;
    const [a, b] = [luminance(parse(style.color).rgb), luminance(behind(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) faint.push([element.textContent, style.color, ratio]);
  }
  return faint;
}"""
SMALL = """least => [...document.querySelectorAll("button")]
  .filter(b => b.checkVisibility())
  .map(b => [b.innerText, b.getBoundingClientRect()])
  .filter(([, box]) => box.width < least || box.height < least)
  .map(([name]) => name)"""

FIRST = (".word", ".axis .value >> nth=2", ".controls .take", ".part h2")


async def fill(page: Page, posed: PosedDaemon) -> None:
    await expect(page.locator(".word")).to_have_text("Ready")
    doubtful = {"quality": {"ok": False, "flags": ["turns_uncertain"]}}
    await posed.take(1)
    await posed.publish(health(arm=posed.arm))
    raised = {"source": "base", "text": "turns are assumed", "remedy": "confirm"}
    posed.pose |= doubtful
    await posed.publish(
        event("device.turns_uncertain", True, severity="error", **raised)
    )
    await expect(page.locator(".word")).to_have_text("In doubt")
    await expect(page.get_by_text("Confirm the arm")).to_be_visible()
    await expect(page.locator("td.state").first).to_be_visible()


@pytest.mark.slow
async def test_every_text_has_contrast_in_both_themes(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with served_page(posed.arm, address) as page:
        async with posed.posing():
            await fill(page, posed)
            await page.get_by_role("button", name="Single point").click()
            for _ in range(2):
                assert await page.evaluate(FAINT) == []
                await change_theme(page)
        await expect(page.locator(".word")).to_have_text("Arm gone")
        await expect(page.get_by_text("Out of date:", exact=True)).to_be_visible()
        faint = await page.evaluate(FAINT)
        # Values of before are grey on purpose, and "STALE" is written over them.
        kept = [text for text, _, _ in faint if not text.strip("-0123456789.± mn\n")]
        assert len(faint) == len(kept), faint


async def test_on_touch_screens_what_matters_is_first_and_can_be_hit(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with (
        posed.posing(),
        served_page(posed.arm, address, has_touch=True, is_mobile=True) as page,
    ):
        await fill(page, posed)
        # A tablet of 820 px is 158 mm wide: 62.3 px are 12 mm.
        for width, height, least in ((390, 844, 44.0), (820, 1180, 62.3)):
            await page.set_viewport_size({"width": width, "height": height})
            for first in FIRST:
                await expect(page.locator(first)).to_be_in_viewport(ratio=1.0)
            assert await page.evaluate(SMALL, least) == []
            for key in await page.locator(".key").all():
                await expect(key).not_to_be_visible()
            script = "document.documentElement.scrollWidth <= innerWidth"
            assert await page.evaluate(script)


@pytest.mark.slow
async def test_digits_can_fill_the_page_and_values_be_spoken(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with posed.posing(), served_page(posed.arm, address) as page:
        await expect(page.locator(".word")).to_have_text("Ready")
        await page.evaluate(
            "window.spoken = [];"
            "speechSynthesis.speak = said => window.spoken.push(said.text); 0"
        )
        await posed.touch(1.0, 2.0, 3.0)
        await page.keyboard.press("v")
        await expect(page.get_by_role("button", name="Silent")).to_be_visible()
        await posed.touch(4.0, 5.0, -6.5)
        await page.wait_for_function("window.spoken.length > 0", polling=100)
        assert await page.evaluate("window.spoken") == ["X 4.000, Y 5.000, Z -6.500"]
        before = await page.locator(".figures").bounding_box()
        await page.keyboard.press("g")
        await expect(page.locator(".lists")).not_to_be_visible()
        after = await page.locator(".figures").bounding_box()
        assert before is not None
        assert after is not None
        assert after["height"] > 1.3 * before["height"]
        await expect(page.locator(".controls .take")).to_be_in_viewport(ratio=1.0)
        await page.keyboard.press("g")
        await expect(page.locator(".lists")).to_be_visible()
