import re

import pytest
from playwright.async_api import Locator, Page, expect

from benchmarks.tools.network import Network
from tests.browser.conftest import OpenPage, PosedDaemon, hears_server
from tests.mosquitto import Mosquitto
from traverse.client.arm import Arm
from traverse.protocol.messages import (
    Label,
    LabelArgs,
    ProbeArgs,
    ScanArgs,
    SessionArgs,
    UndoArgs,
)
from traverse.testing.waiting import until

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]


def rows(page: Page) -> Locator:
    seventh = page.locator("td:nth-child(7)")
    return page.locator("table.plain tbody tr", has=seventh)


async def are_shown(page: Page, n: int) -> None:
    await expect(rows(page)).to_have_count(n)
    await page.wait_for_function(
        "n => traverse_scene.points.size === n", arg=n, polling=100
    )


async def cells(page: Page, row: int) -> list[str]:
    return await rows(page).nth(row).locator("td").all_inner_texts()


@pytest.mark.slow
async def test_the_sessions_points_are_all_there_whatever_happens(
    posed: PosedDaemon, own_broker: Mosquitto, served_page: OpenPage
) -> None:
    async with Network(own_broker.port) as network, posed.posing():
        await posed.take(4, age_s=60.0)  # before there is a page
        broker = f"localhost:{network.port}"
        async with served_page(posed.arm, broker) as page:
            await are_shown(page, 4)
            assert await page.evaluate("traverse_sounds.played.length") == 0
            await page.reload()
            await are_shown(page, 4)
            posed.is_mute = True  # messages that the page misses while disconnected
            await posed.take(3, age_s=60.0)
            posed.is_mute = False
            await network.cut()
            await are_shown(page, 7)
            await page.reload()
            await are_shown(page, 7)
            await posed.touch(1.0, 2.0, 3.0)
            await are_shown(page, 8)
            await page.wait_for_function(
                "traverse_sounds.played.filter(kind => kind === 'point').length === 1"
            )
            for n in range(10):  # late and new ones at one time
                await posed.take(1, age_s=60.0)
                await posed.touch(float(n), 0.0, 0.0)
            await are_shown(page, 28)


@pytest.mark.slow
async def test_a_new_session_is_requested_and_the_earlier_one_can_be_shown(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with posed.posing(), served_page(posed.arm, address) as page:
        for x in range(3):
            await posed.touch(float(x), 0.0, 0.0)
        await are_shown(page, 3)
        dialog = page.get_by_role("dialog")
        await page.keyboard.press("n")
        await expect(dialog).to_contain_text("It has 3 points now")
        await dialog.get_by_role("button", name="Cancel").click()
        await expect(dialog).to_have_count(0)
        await are_shown(page, 3)
        await page.keyboard.press("n")
        await dialog.get_by_label("Note").fill("second shift")
        await dialog.get_by_role("button", name="New session").click()
        await are_shown(page, 0)
        assert SessionArgs(action="new", note="second shift") in posed.commands
        await posed.touch(9.0, 9.0, 9.0)
        await are_shown(page, 1)

        await page.get_by_role("button", name="Earlier session").click()
        await are_shown(page, 3)
        await expect(page.get_by_text("of an earlier session: 3")).to_be_visible()
        await page.get_by_role("button", name="Back to now").click()
        await are_shown(page, 1)


async def test_differences_to_the_last_point_and_to_a_nominal_place_and_spacings(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    posed.pose["xyz_mm"] = [13.0, 24.0, 30.0]
    async with posed.posing(), served_page(posed.arm, address) as page:
        undo = page.locator(".controls").get_by_role("button", name="Undo")
        await expect(page.locator(".step")).to_have_count(0)
        for x in (1.0, 10.0):
            last = await posed.touch(x, 20.0, 30.0)
        await expect(undo).to_contain_text("Undo 1")
        step = page.locator(".step")
        await expect(step).to_contain_text("from point 1")
        await expect(step).to_contain_text("ΔX +3.000  ΔY +4.000  ΔZ +0.000")
        await expect(step).to_contain_text("5.000 mm")
        await page.keyboard.press("u")
        await are_shown(page, 1)
        assert posed.commands[-1] == UndoArgs(id=last.id)
        await expect(page.get_by_role("status")).to_contain_text("undoes 1")
        await expect(undo).to_contain_text("Undo 0")
        await expect(step).to_contain_text("from point 0")

        # A nominal place with its tolerance.
        posed.pose |= {
            "xyz_mm": [100.03, 7.0, 9.0],
            "covariance_mm2": [1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6],
        }
        await page.get_by_role("button", name="Nominal: none").click()
        await page.get_by_label("X in mm").fill("100")
        await page.get_by_label("Tolerance").fill("0.05")
        await page.get_by_role("button", name="Set").click()
        bar = page.locator(".nominal").first
        await expect(bar).to_contain_text("ΔX +0.030")
        await expect(bar).to_contain_text("0.030 of 0.050 mm: in tolerance")
        await expect(bar).to_have_class(re.compile("good"))
        posed.pose["xyz_mm"] = [99.949, 7.0, 9.0]
        await expect(bar).to_contain_text("undecided")
        posed.pose["xyz_mm"] = [99.9, 7.0, 9.0]
        await expect(bar).to_contain_text("out of tolerance")
        await expect(bar).to_have_class(re.compile("bad"))

        # A scan is by time or has a spacing.
        spacing = page.get_by_role("button", name="Scan: ")
        await expect(spacing).to_have_text("Scan: by time")
        for entered in ("-1", "0.25"):
            await spacing.click()
            await page.get_by_label("Spacing in mm").fill(entered)
            await page.keyboard.press("Enter")
            await expect(page.get_by_role("dialog")).to_have_count(0)
            if entered == "-1":
                status = page.get_by_role("status")
                await expect(status).to_contain_text("-1 is no spacing")
        await expect(spacing).to_have_text("Scan: each 0.250 mm")
        await page.keyboard.press("s")
        expected = ScanArgs(action="start", mode="distance", spacing_mm=0.25)
        await until(lambda: posed.commands[-1] == expected, "a scan with a spacing")


async def test_read_out_and_list_are_in_one_system_and_unit(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    posed.pose |= {
        "xyz_mm": [25.4, -0.0001, 50.8],
        "part_xyz_mm": [1.0, 2.0, -0.0004],
        "covariance_mm2": [1e-4, 0.0, 0.0, 4e-4, 0.0, 9e-4],
    }
    async with posed.posing(), served_page(posed.arm, address) as page:
        await posed.touch(25.4, 0.0, 0.0, part_xyz_mm=None)  # before the alignment
        await posed.touch(25.4, -1e-5, 0.0, part_xyz_mm=(4.0, 5.0, 6.0))
        await are_shown(page, 2)
        values = page.locator(".axis .value")
        await expect(values).to_have_text(["1.000", "2.000", "0.000"])
        system = page.locator(".figures .system")
        await expect(system).to_have_text("Ball centre, part's system, vice")
        await expect(page.locator("h2", has_text="Points: 2")).to_contain_text(
            "part's system, vice"
        )
        around = page.locator(".axis .around")
        await expect(around).to_have_text([re.compile("± 0.060")] * 3)  # the worst
        assert (await cells(page, 0))[1:4] == ["4.000", "5.000", "6.000"]
        assert (await cells(page, 1))[1:4] == ["-", "-", "-"]
        assert "before the alignment" in (await cells(page, 1))[6]

        await page.get_by_role("button", name="Coordinates").click()
        await expect(values).to_have_text(["25.400", "0.000", "50.800"])
        await expect(page.locator("h2", has_text="Points: 2")).to_contain_text(
            "arm's system"
        )
        await expect(around.first).to_contain_text("± 0.020")
        assert (await cells(page, 0))[1:4] == ["25.400", "0.000", "0.000"]

        await page.get_by_role("button", name="Unit: mm").click()
        await expect(values).to_have_text(["1.00000", "0.00000", "2.00000"])
        await expect(rows(page).first).to_contain_text("1.00000")
        await expect(page.locator("th", has_text="inch")).to_have_count(3)
        await expect(page.locator(".sectors b").first).to_have_text("7.162°")


async def test_probe_and_label_are_shown_and_changed(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with posed.posing(), served_page(posed.arm, address) as page:
        probe = page.get_by_role("button", name=re.compile("Probe.*:"))
        await expect(probe).to_contain_text("radius 3.000 mm")
        await probe.click()
        await page.get_by_label("Name in the probe library").fill("ball-6")
        await page.keyboard.press("Enter")
        await expect(page.get_by_role("dialog")).to_have_count(0)
        assert posed.commands[-1] == ProbeArgs(name="ball-6")
        # A probe is chosen from a known library.
        await expect(probe).to_contain_text("Probe ball-6:")
        posed.probes = ("star-left", "ball-6")
        await posed.begin_session()
        dialog = page.get_by_role("dialog")
        answers = dialog.get_by_role("button")
        await probe.click()
        await expect(dialog).to_be_visible()
        while await answers.count() < 3:  # opened before the status arrived
            await page.keyboard.press("Escape")
            await expect(dialog).to_have_count(0)
            await probe.click()
            await expect(dialog).to_be_visible()
        await expect(answers).to_have_text(["ball-6", "star-left", "Cancel"])
        await page.get_by_role("button", name="star-left").click()
        await expect(probe).to_contain_text("Probe star-left:")
        assert posed.commands[-1] == ProbeArgs(name="star-left")
        await posed.touch(0.0, 0.0, 0.0, label=Label(artefact="plate", feature="hole"))
        await expect(page.get_by_text("Label: plate hole")).to_be_visible()
        await page.keyboard.press("l")
        await expect(page.get_by_label("Artefact")).to_have_value("plate")
        await page.get_by_label("Artefact").fill("N P")  # keys are text here
        await page.get_by_role("button", name="Set").click()
        await expect(page.get_by_role("dialog")).to_have_count(0)
        assert posed.commands[-1] == LabelArgs(artefact="N P", feature="hole")


@pytest.mark.slow
async def test_a_guided_check_has_a_verdict_and_refuses_another_seat(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    async with posed.posing(), served_page(posed.arm, address) as page:
        async with Arm(posed.arm, address) as other:
            await other.label("bar", "left")  # and forgets to end it
        theirs = Label(artefact="bar", feature="left")
        await posed.touch(0.0, 0.0, 0.0, label=theirs)
        await expect(page.get_by_text("Label: bar left")).to_be_visible()
        await page.get_by_role("button", name="Single point").click()
        verdict, instruction = page.locator(".verdict"), page.locator(".instruction")
        await expect(verdict).to_have_text("0 of 10 points")
        for number in range(9):
            await posed.touch(600.0, 0.01 * (number % 2), 60.0, label=theirs)
        await expect(instruction).to_contain_text("1 more")

        # A touch in another seat does not count until the operator confirms.
        await posed.touch(653.0, 0.0, 60.0)
        await expect(instruction).to_contain_text("53.0 mm off the others")
        await expect(instruction).to_contain_text("Was it the right seat?")
        await page.reload()  # which forgets nothing
        await hears_server(page)
        await page.get_by_role("button", name="Another place").click()
        await expect(instruction).to_contain_text("1 more")
        await posed.touch(600.0, 0.01, 60.0)

        # Nothing passes without a limit.
        await expect(verdict).to_have_text("No verdict: set a limit.")
        await expect(verdict).to_have_class(re.compile("warning"))
        for limit, words, level in (
            ("0.004", "Failed", "bad"),
            ("0.05", "Passed", "good"),
        ):
            await page.get_by_role("button", name="Limit:").click()
            await page.get_by_label("Limit in mm").fill(limit)
            await page.get_by_role("button", name="Set").click()
            await expect(verdict).to_contain_text(words)
            await expect(verdict).to_contain_text(f"limit {float(limit):.4f} mm")
            await expect(verdict).to_have_class(re.compile(level))
        await page.get_by_role("button", name="Close").click()
        await expect(instruction).to_have_text("")
        await expect(page.get_by_text("have been")).to_be_visible()
        # The command follows what is shown.
        last = LabelArgs(artefact="bar", feature="left")
        await until(lambda: posed.commands[-1] == last, "the label is as before")
    labels = [args for args in posed.commands if isinstance(args, LabelArgs)]
    assert labels == [last, LabelArgs(artefact="check", feature="articulation"), last]
