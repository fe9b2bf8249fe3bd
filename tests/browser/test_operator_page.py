import json
import re

import pytest
from playwright.async_api import expect

from tests.browser.conftest import OpenPage, Scene
from tests.end_to_end.workbench import REST

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]


async def sounds(scene: Scene, kind: str) -> None:
    await scene.page.wait_for_function(
        "kind => traverse_sounds.played.includes(kind)", arg=kind, polling=100
    )


async def test_a_morning_with_the_page(scene: Scene) -> None:
    page = scene.page
    banner = page.locator("header")
    await expect(banner).to_contain_text("Ready to measure.")
    await expect(banner).to_have_class(re.compile("good"))

    # The arm takes three points by itself; the fourth is requested by keyboard.
    rows = page.locator("table.plain tbody tr", has=page.locator("td:nth-child(7)"))
    await expect(rows).to_have_count(3)
    await sounds(scene, "point")
    await page.keyboard.press("Space")
    await expect(rows).to_have_count(4)
    value = page.locator(".axis .value").first
    await expect(value).to_have_text(re.compile(r"^-?\d+\.\d{3}$"))
    await expect(page.locator(".axis .around").first).to_contain_text("±")
    await page.wait_for_function("traverse_scene.points.size === 4", polling=100)
    assert await page.evaluate("traverse_scene.arm.children.length") == 15

    # It is taken back, by the button this time.
    await page.get_by_role("button", name="Undo").click()
    await expect(rows).to_have_count(3)
    await page.wait_for_function("traverse_scene.points.size === 3", polling=100)
    await sounds(scene, "retraction")
    await expect(page.get_by_role("status")).to_contain_text("undoes")

    # What is not possible is refused with the reason.
    for _ in range(4):
        await page.keyboard.press("u")
    await expect(page.get_by_role("status")).to_contain_text("no point")
    await sounds(scene, "refused")
    # The daemon replies, and reports an event: one message and one sound.
    await page.keyboard.press("l")  # everything sent before has arrived by then
    await page.get_by_label("Artefact").fill("plate")
    await page.get_by_role("button", name="Set").click()
    await expect(page.get_by_text("Label: plate")).to_be_visible()
    played = "traverse_sounds.played.filter(kind => kind === 'refused').length"
    assert await page.evaluate(played) == 1

    # A scan runs until it is stopped, and is drawn.
    await page.keyboard.press("s")
    await expect(page.get_by_role("button", name="Stop scan")).to_be_visible()
    await page.wait_for_function("traverse_scene.drawn.n > 50", polling=100)
    await expect(page.locator(".arm-scene-note")).to_contain_text("scanned points")
    await page.keyboard.press("s")
    await expect(page.get_by_role("button", name="Start scan")).to_be_visible()


@pytest.mark.slow
async def test_points_are_labelled_and_saved_and_nobody_needs_a_mouse(
    scene: Scene, served_page: OpenPage
) -> None:
    page = scene.page
    rows = page.locator("table.plain tbody tr", has=page.locator("td:nth-child(7)"))
    await expect(rows).to_have_count(3)
    await page.keyboard.press("l")
    await page.get_by_label("Artefact").fill("plate")
    await page.get_by_role("button", name="Set").click()
    await expect(page.get_by_role("dialog")).to_have_count(0)
    await page.keyboard.press("Space")
    await expect(rows.first).to_contain_text("plate")
    # A server that is started in mid-session shows all of it.
    broker = f"{scene.broker.host}:{scene.broker.port}"
    async with served_page(scene.bench.arm, broker) as later:
        await expect(later.locator("table.plain td:nth-child(7)")).to_have_count(4)
        await expect(later.get_by_text("Label: plate")).to_be_visible()
        await later.wait_for_function("traverse_scene.points.size === 4", polling=100)
    async with page.expect_download() as saving:
        await page.get_by_role("button", name="Save points as JSON").click()
    path = await (await saving.value).path()
    saved = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    assert [p["label"]["artefact"] for p in saved] == [None, None, None, "plate"]

    # Every button is reached by keys, and has a name.
    await expect(page.get_by_role("button", name="Undo 3")).to_be_enabled()
    names = []
    for _ in range(70):  # around, from wherever the focus was
        await page.keyboard.press("Tab")
        script = "document.activeElement.ariaLabel || document.activeElement.innerText"
        names.append(str(await page.evaluate(script)).split("\n")[0].lower())
    for expected in (
        *("take point", "undo 3", "start scan", "top", "save points as csv"),
        *("circle", "distance", "open the report sheet"),
    ):
        assert expected in names, names
    unnamed = await page.evaluate(
        "[...document.querySelectorAll('button')]"
        ".filter(b => !(b.innerText || b.ariaLabel || '').trim()).length"
    )
    assert unnamed == 0
    await page.keyboard.press("d")
    await expect(page.locator("body")).to_have_class(re.compile("body--light"))
    await page.set_viewport_size({"width": 820, "height": 1180})
    await expect(page.get_by_role("button", name="Take point")).to_be_in_viewport()


@pytest.mark.slow
async def test_outages_are_unmistakable_and_pass(scene: Scene) -> None:
    page, banner = scene.page, scene.page.locator("header")
    await expect(banner).to_contain_text("Ready to measure.")
    rows = page.locator("table.plain tbody tr", has=page.locator("td:nth-child(7)"))
    await expect(rows).to_have_count(3)  # all that are taken by themselves

    # A device is unplugged, and plugged in again.
    await scene.bench.kill_simulator(scene.simulator)
    await expect(banner).to_have_class(re.compile("bad"))
    await expect(banner).to_contain_text("base")
    await sounds(scene, "alarm")
    await expect(page.locator(".figures")).to_have_class(re.compile("stale"))
    scene.bench.write_simulator(REST)  # which takes no points by itself
    with scene.bench.simulator("simulator-again"):
        await sounds(scene, "cleared")

        # Its encoders are absolute, and it is the board that was confirmed.
        await expect(banner).to_contain_text("Ready to measure.")

        # The broker is killed, and restarted.
        scene.broker.kill()
        await expect(banner).to_contain_text("No connection to the broker")
        await expect(page.get_by_text("STALE", exact=True)).to_be_visible()
        colour = await banner.evaluate("e => getComputedStyle(e).backgroundColor")
        assert colour == "rgb(192, 27, 16)"
        scene.broker.start()
        await expect(banner).to_contain_text("Ready to measure.")
        await expect(page.get_by_text("STALE", exact=True)).not_to_be_visible()
        await page.keyboard.press("Space")  # the daemon, too, is back
        await expect(page.get_by_role("status")).to_contain_text("Point 3")

        # The daemon is killed: its last will says so.
        scene.daemon.process.kill()
        scene.daemon.process.wait()
        await expect(banner).to_contain_text("The arm is off line")
