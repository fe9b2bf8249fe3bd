"""The page never says "Ready" where a number would be in doubt, or is out of date."""

import re

import numpy as np
import pytest
from playwright.async_api import Page, expect

from tests.browser.conftest import OpenPage, PosedDaemon
from tests.client.display.values import event, health
from tests.protocol.message_examples import SCAN
from traverse.protocol.messages import HomeArgs, QualityFlag, ReferenceArgs, Scan

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]

FINE = {"quality": {"ok": True, "flags": []}}


async def is_said(page: Page, word: str, level: str) -> None:
    await expect(page.locator(".word")).to_have_text(word)
    await expect(page.locator("header")).to_have_class(re.compile(rf"\b{level}\b"))


async def invites_as_the_banner(page: Page) -> None:
    """The button that takes a point has the banner's colour."""
    colour = "n => getComputedStyle(document.querySelector(n)).backgroundColor"
    script = f"() => ({colour})('.take') === ({colour})('.banner')"
    await page.wait_for_function(script, polling=100)


async def n_played(page: Page, kind: str) -> int:
    script = "kind => traverse_sounds.played.filter(k => k === kind).length"
    return int(await page.evaluate(script, kind))


def block(n: int, seq: int, **changes: object) -> Scan:
    fields = {name: getattr(SCAN, name) for name in Scan.model_fields}
    del fields["schema_"]
    joints = fields["angles_rad"].shape[1]
    fields |= {
        "seq": seq,
        "dtime_ns": np.arange(n) * 1000,
        "xyz_mm": np.zeros((n, 3)) + seq,
        "ijk": np.tile([0.0, 0.0, 1.0], (n, 1)),
        "angles_rad": np.zeros((n, joints)),
        "counts": None,
        "part_xyz_mm": None,
        "covariance_mm2": None,
        "quality": np.zeros(n, np.uint32),
        "dropped": 0,
        "in_doubt": 0,
        "lost": 0,
        "last": False,
        "total": None,
        **changes,
    }
    return Scan(**fields)


async def test_doubts_and_alarms_and_scans_have_states_of_their_own(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with posed.posing(), served_page(posed.arm, address) as page:
        await is_said(page, "Ready", "good")

        # A pose with a flag, whichever it is; moving fast alone is no doubt of the arm.
        posed.pose["quality"] = {"ok": False, "flags": ["turns_uncertain"]}
        await is_said(page, "In doubt", "warning")
        await expect(page.locator("header")).to_contain_text("turns uncertain")
        await invites_as_the_banner(page)
        await expect(page.locator("header")).to_contain_text("Reference the arm")
        await page.get_by_role("button", name="Confirm the arm's position").click()
        await page.get_by_role("button", name="It is right").click()
        await expect(page.get_by_role("dialog")).to_have_count(0)
        assert posed.commands[-1] == ReferenceArgs(action="confirm")
        await page.get_by_role("button", name="The arm is in its home posture").click()
        await page.get_by_role("button", name="It is in its home posture").click()
        await expect(page.get_by_role("dialog")).to_have_count(0)
        assert posed.commands[-1] == HomeArgs()
        posed.pose["quality"] = {"ok": False, "flags": ["geometry_unknown"]}
        await expect(page.locator("header")).to_contain_text("geometry unknown")
        await expect(page.locator(".figures")).to_contain_text("U: geometry unknown")
        await expect(page.locator(".figures")).not_to_contain_text("±")
        posed.pose["quality"] = {"ok": False, "flags": ["overspeed"]}
        await is_said(page, "Moving", "busy")
        posed.pose |= FINE
        await is_said(page, "Ready", "good")

        # A lasting warning, and its end.
        raised = {"source": "base", "text": "turns are assumed", "remedy": "check"}
        restarted = event("device.restarted", True, severity="warning", **raised)
        await posed.publish(restarted)
        await is_said(page, "In doubt", "warning")
        await expect(page.locator("header")).to_contain_text("turns are assumed")
        ended = {"source": "base", "text": "turns are assumed"}
        await posed.publish(event("device.restarted", False, severity="info", **ended))
        await is_said(page, "Ready", "good")
        message = page.get_by_role("status")
        await expect(message).to_have_text("Ended: turns are assumed")

        # A scan, with its losses and doubts, and its end.
        doubtful = np.zeros(40, np.uint32)
        doubtful[:5] = QualityFlag.END_STOP
        await posed.publish(block(60, 0))
        await posed.publish(block(40, 60, lost=3, quality=doubtful, in_doubt=5))
        await is_said(page, "Scanning", "busy")
        header = page.locator("header")
        await expect(header).to_contain_text("100 points, 3 lost, 5 in doubt")
        posed.pose["quality"] = {"ok": False, "flags": ["singular"]}
        await is_said(page, "In doubt", "warning")
        await expect(header).to_contain_text("Scanning: 100 points")
        posed.pose |= FINE
        await posed.publish(block(0, 100, lost=3, last=True, total=100, in_doubt=5))
        await is_said(page, "Ready", "good")
        await expect(message).to_have_text(
            "Scan ended: 100 points, 3 lost, 5 in doubt."
        )


@pytest.mark.slow
async def test_nothing_is_green_when_broker_or_arm_is_gone(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with served_page(posed.arm, address) as page:
        take = page.get_by_role("button", name="Take point")
        async with posed.posing():
            await is_said(page, "Ready", "good")
            await posed.publish(health(arm=posed.arm))
            await expect(page.get_by_text("connected")).to_be_visible()
            await expect(take).to_be_enabled()
            await expect(page.locator(".sectors rect.here").first).to_be_visible()

        await is_said(page, "Arm gone", "bad")
        for name in ("Take point", "Mean of", "Undo", "Start scan", "New session"):
            await expect(page.get_by_role("button", name=name)).to_be_disabled()
        await expect(page.get_by_text("Out of date:", exact=True)).to_be_visible()
        await expect(page.get_by_text("have been: out of date")).to_be_visible()
        for removed in (".state.good", ".sectors rect.here", ".message .point"):
            await expect(page.locator(removed)).to_have_count(0)
        await expect(page.get_by_text("connected", exact=True)).to_have_count(0)
        assert await n_played(page, "alarm") == 1

        # A key says why nothing happens: once, and not over the read-out.
        await page.keyboard.press("Space")
        message = page.get_by_role("status")
        await expect(message).to_contain_text("Refused: This is not possible now")
        await expect(message).to_contain_text("The arm is off line")
        assert await n_played(page, "refused") == 1
        boxes = [
            await page.locator(selector).bounding_box()
            for selector in (".message", ".figures")
        ]
        assert boxes[0] is not None
        assert boxes[1] is not None
        assert boxes[0]["y"] + boxes[0]["height"] <= boxes[1]["y"]

        async with posed.posing():
            await is_said(page, "Ready", "good")
            await expect(take).to_be_enabled()
            assert await n_played(page, "cleared") == 1
