"""A part of known truth is measured on the page, from the first touch to the report."""

import asyncio
import json
import os
import time

import numpy as np
import pytest
from playwright.async_api import Page, expect
from scipy.spatial.transform import Rotation

from tests.browser.conftest import OpenPage, PosedDaemon
from tests.client.display.test_inspection_desk import scan_of
from tests.client.display.values import doubt
from tests.client.inspection.touched import ARM, touched_points
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.helmert.transformation import Helmert
from traverse.lab.measured_points.touch_errors import shared_by_points
from traverse.protocol.messages import Point

pytestmark = [
    pytest.mark.needs("mosquitto", "chromium"),
    pytest.mark.asyncio(loop_scope="session"),
]
SIZES = {"desk": (1600, 900), "phone": (390, 844)}


def measured() -> tuple[
    dict[str, list[Point]], dict[str, np.ndarray], dict[str, float]
]:
    """Points of the part by feature, their common errors, and the part's truth."""
    points, truth = touched_points()
    by_feature: dict[str, list[Point]] = {}
    for point in points:
        by_feature.setdefault(point.label.feature or "", []).append(point)
    factors = shared_by_points(points, ARM, read_arm(ARM))
    return by_feature, {p.id: f for p, f in zip(points, factors, strict=True)}, truth


async def touch_all(posed: PosedDaemon, points: list[Point], shared) -> None:
    """The arm takes these points, and can report their common errors."""
    for point in points:
        fields = {
            name: getattr(point, name)
            for name in (
                *("ijk", "surface_mm", "compensation", "covariance_mm2", "angles_rad"),
                *("counts", "probe_radius_mm", "model", "label"),
            )
        }
        touched = await posed.touch(*point.xyz_mm, **fields)
        posed.shared_mm[touched.id] = shared[point.id].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
async def test_a_plate_with_holes_is_measured_by_touches(
    posed: PosedDaemon, address: str, served_page: OpenPage, size: str
) -> None:
    by_feature, shared, truth = measured()
    width, height = SIZES[size]
    options = {"viewport": {"width": width, "height": height}}
    if size != "desk":
        options |= {"has_touch": True, "is_mobile": True}
    async with posed.posing(), served_page(posed.arm, address, **options) as page:
        part = page.locator(".part")
        for kind, feature in (
            *(("Plane", "plate"), ("Circle", "hole a"), ("Circle", "hole b")),
        ):
            if feature == "hole b":  # one more of its kind, by a pedal that is a key
                await page.keyboard.press("e")
            else:
                await part.get_by_role("button", name=kind, exact=True).click()
            await expect(part.locator(".asks")).to_contain_text("0 touches")
            await touch_all(posed, by_feature[feature], shared)
            n = len(by_feature[feature])
            await expect(part.locator(".touches button")).to_have_count(n)
            await expect(part.locator(".result")).to_contain_text("±")
            if size != "desk":
                await expect(page.locator(".controls .take")).to_be_in_viewport()
                await expect(part.locator(".asks")).to_be_in_viewport()
            await picture(page, f"touching-{size}")
            if feature == "plate":
                await part.get_by_role("button", name="Accept").click()
            else:
                await page.keyboard.press("e")
            await expect(part.locator(".asks")).not_to_be_visible()
        await expect(part.locator(".feature:visible")).to_have_count(3)
        await relate(page, "Distance", "circle 1", "circle 2")
        await tolerance(page, "distance 1", "distance", (50.0, -1.0, 1.0))
        row = part.locator(".feature", has_text="distance 1")
        await expect(row).to_contain_text("not judged")
        await expect(part.locator(".left-out")).to_contain_text("the ball's radius")
        await conditions(page, "0.0005", "20", "0.2", "1.15e-5", "1e-6")
        await expect(row).to_contain_text("] conforming")
        await expect(part.locator(".left-out")).to_have_text("")
        await picture(page, f"part-{size}")

        answer = await page.request.get(page.url + "report")
        sheet = await answer.text()
        assert "conforming" in sheet
        assert by_feature["plate"][0].model in sheet
        async with page.expect_download() as download:
            await part.get_by_role("button", name="Save results as JSON").click()
        path = await (await download.value).path()
        report = json.loads(path.read_text())
        named = {
            f"{feature['name']} {figure['name']}": figure
            for feature in report["features"]
            for figure in feature["figures"]
        }
        for name, of in (
            ("circle 1 diameter", "hole a diameter"),
            ("circle 2 diameter", "hole b diameter"),
            ("distance 1 distance", "hole a to hole b"),
        ):
            off = abs(named[name]["value"] - truth[of])
            assert off <= named[name]["expanded"] < 0.1


@pytest.mark.slow
async def test_a_plate_and_a_hole_are_measured_by_scans(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    by_feature, shared, truth = measured()
    every = by_feature["plate"] + by_feature["hole a"]
    posed.shared_mm |= {p.angles_rad: shared[p.id].tolist() for p in every}

    async def scan(feature: str, name: str) -> None:
        for start in (0, 20, 42):  # two samples are lost
            ends = {"last": start == 42, "total": 62 if start == 42 else None}
            numbers = range(start, start + 20)
            block = scan_of(feature, numbers, scan=name, time_ns=time.time_ns(), **ends)
            await posed.publish(block)
            if start == 20:
                so_far = f"scan {name}: {len(by_feature[feature])} of 40 samples"
                await expect(part.locator(".result")).to_have_text(so_far)
                await picture(page, f"scanning-{name}")

    async with posed.posing(), served_page(posed.arm, address) as page:
        part, dialog = page.locator(".part"), page.get_by_role("dialog")
        await part.get_by_role("button", name="Plane", exact=True).click()
        await expect(part.locator(".asks")).to_contain_text("0 touches")
        await scan("plate", "s-3")
        rows = part.locator(".touches button")
        await expect(rows).to_have_text(["scan s-3: 6 of 60 samples, 2 lost"])
        await expect(part.locator(".result")).to_contain_text("±")
        await part.get_by_role("button", name="Accept").click()
        await part.get_by_role("button", name="Circle", exact=True).click()
        await expect(part.locator(".asks")).to_contain_text("circle 1")
        begun_ns = time.time_ns()
        await scan("hole a", "s-4")
        await expect(part.locator(".result")).to_contain_text("is not known")
        await part.get_by_role("button", name="Side: as compensated").click()
        await expect(part.locator(".result")).to_contain_text("±")
        await touch_all(posed, by_feature["hole a"][:1], shared)
        await expect(rows).to_have_count(2)
        await picture(page, "scanned")
        # What shows later names the time of the last scan.
        await posed.put_in_doubt(doubt(begun_ns, time.time_ns() + 10**10))
        await page.wait_for_function("traverse_scene.doubts.length > 0")
        await expect(part.locator(".touches")).to_contain_text("in doubt")
        await picture(page, "in-doubt")
        async with page.expect_download() as download:
            await part.get_by_role("button", name="Save results as JSON").click()
        report = json.loads((await (await download.value).path()).read_text())
        figures = {
            figure["name"]: figure for figure in report["features"][1]["figures"]
        }
        off = abs(figures["diameter"]["value"] - truth["hole a diameter"])
        assert off <= figures["diameter"]["expanded"] < 0.1
        await rows.first.click()
        await dialog.get_by_role("button", name="Leave it out").click()
        await expect(rows).to_have_count(1)
        await expect(part.locator(".asks")).to_contain_text("1 touch;")


@pytest.mark.slow
async def test_bores_and_an_apex_are_fitted_onto_nominal_places(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    """By the truth in the arm's system: residuals are within U, and the system its."""
    by_feature, shared, truth = measured()
    async with posed.posing(), served_page(posed.arm, address) as page:
        part, dialog = page.locator(".part"), page.get_by_role("dialog")
        fit = part.get_by_role("button", name="Align best fit")
        await fit.click()
        await expect(page.locator(".message")).to_contain_text("three features")
        for kind, feature in (
            *(("Plane", "plate"), ("Circle", "hole a"), ("Circle", "hole b")),
            ("Cone", "cone"),
        ):
            await part.get_by_role("button", name=kind, exact=True).click()
            await expect(part.locator(".asks")).to_contain_text("0 touches")
            await touch_all(posed, by_feature[feature], shared)
            n = len(by_feature[feature])
            await expect(part.locator(".touches button")).to_have_count(n)
            await expect(part.locator(".result")).to_contain_text("±")
            await part.get_by_role("button", name="Accept").click()
        await part.get_by_role("button", name="Apex").click()
        await dialog.get_by_role("button", name="cone 1").click()
        row = part.locator(".feature", has_text="apex 1")
        await expect(row).to_contain_text("±")
        hole_a, hole_b = (
            [truth[f"hole {name} {axis}"] for axis in "xyz"] for name in "ab"
        )
        places = (hole_a, hole_b, np.add(hole_a, [25.0, 0.0, 70.0]))
        await fit.click()
        await expect(dialog.locator("input")).to_have_count(3)
        for field, place in enumerate(places):
            text = " ".join(f"{mm:.4f}" for mm in place)
            await dialog.locator("input").nth(field).fill(text)
        await picture(page, "best-fit-places")
        await dialog.get_by_role("button", name="Fit", exact=True).click()
        await expect(dialog).to_contain_text("(redundancy 3).")
        await expect(dialog).to_contain_text("not in one plane")
        await picture(page, "best-fit")
        await dialog.get_by_role("button", name="Use it").click()
        await expect(row).to_contain_text(f"x {places[2][0]:.0f}"[:4])
        await picture(page, "best-fit-used")


@pytest.mark.slow
async def test_an_arm_that_is_moved_goes_on_in_the_first_system(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    by_feature, shared, _ = measured()
    system = Helmert(
        Rotation.from_euler("xyz", [0.1, -0.2, 2.0]).as_matrix(),
        np.array([400.0, -100.0, 20.0]),
    )
    once = (
        *(("Plane", by_feature["plate"]), ("Circle", by_feature["hole a"])),
        *(("Circle", by_feature["hole b"]), ("Point", by_feature["edge"][:1])),
        ("Point", by_feature["edge"][3:]),
    )
    async with posed.posing(), served_page(posed.arm, address) as page:
        part, dialog = page.locator(".part"), page.get_by_role("dialog")
        for kind, points in once:
            await part.get_by_role("button", name=kind, exact=True).click()
            await expect(part.locator(".asks")).to_contain_text("0 touches")
            await touch_all(posed, points, shared)
            await expect(part.locator(".touches button")).to_have_count(len(points))
            await part.get_by_role("button", name="Accept").click()
        row = part.locator(".feature", has_text="point 2").first
        await expect(row).to_contain_text("±")
        before = await row.text_content()
        await part.get_by_role("button", name="Arm moved").click()
        await dialog.get_by_role("button", name="It was moved").click()
        await expect(part.get_by_role("button", name="Sphere")).not_to_be_visible()
        names = ("plane 1", "circle 1", "circle 2", "point 1", "point 2")
        for name, (_, points) in zip(names, once, strict=True):
            again = part.locator(".feature", has_text=f"{name} again 1")
            await again.click()
            await dialog.get_by_role("button", name="Touch more").click()
            await expect(part.locator(".asks")).to_contain_text("0 touches")
            await touch_all(posed, [moved(point, system) for point in points], shared)
            await expect(part.locator(".touches button")).to_have_count(len(points))
            await part.get_by_role("button", name="Accept").click()
        await expect(again).to_contain_text("not joined yet")
        await picture(page, "leapfrog-touched")
        await part.get_by_role("button", name="Join", exact=True).click()
        await expect(dialog).to_contain_text("Touched places are good to")
        await picture(page, "leapfrog-fit")
        await dialog.get_by_role("button", name="Use it").click()
        await expect(again).to_contain_text("±")
        await expect(row).to_have_text(before or "")
        await picture(page, "leapfrog-joined")


def moved(point: Point, system: Helmert) -> Point:
    """The same touch from a station that `system` leads to the first one from."""
    back = system.inverse()
    places_mm = back.places_mm(np.array([point.xyz_mm, point.surface_mm]))
    xyz_mm, surface_mm = map(tuple, places_mm.tolist())
    ijk = tuple((back.rotation @ np.array(point.ijk)).tolist())
    changes = {"xyz_mm": xyz_mm, "surface_mm": surface_mm, "ijk": ijk}
    return point.model_copy(update=changes)


async def test_touches_can_be_left_out_moved_and_undone(
    posed: PosedDaemon, address: str, served_page: OpenPage
) -> None:
    by_feature, shared, _ = measured()
    async with posed.posing(), served_page(posed.arm, address) as page:
        part = page.locator(".part")
        touches = part.locator(".touches button")
        await part.get_by_role("button", name="Plane", exact=True).click()
        await expect(part.locator(".asks")).to_contain_text("0 touches")
        await touch_all(posed, by_feature["plate"], shared)
        await expect(touches).to_have_count(6)
        dialog = page.get_by_role("dialog")
        await touches.nth(2).click()
        await dialog.get_by_role("button", name="Leave it out").click()
        await expect(touches).to_have_count(5)
        await part.get_by_role("button", name="Accept").click()
        await part.get_by_role("button", name="Cylinder", exact=True).click()
        await expect(part.locator(".asks")).to_contain_text("0 touches")
        await touch_all(posed, by_feature["plate"][:1], shared)
        await expect(touches).to_have_count(1)
        await touches.first.click()
        await dialog.get_by_role("button", name="Move to plane 1").click()
        await expect(touches).to_have_count(0)
        await part.get_by_role("button", name="Accept").click()
        await expect(part.locator(".feature")).to_have_count(1)  # the empty one is gone
        await part.locator(".feature").click()
        await dialog.get_by_role("button", name="Touch more").click()
        await expect(touches).to_have_count(6)
        last = posed.points[-1]
        await posed.publish(
            last.retraction(
                seq=99, point_id="back", trigger="command", time_ns=last.time_ns + 1
            )
        )
        await expect(touches).to_have_count(5)


async def relate(page: Page, kind: str, *names: str) -> None:
    button = page.locator(".relations").get_by_role("button", name=kind)
    await button.click()
    dialog = page.get_by_role("dialog")
    for ordinal, name in zip(("First", "Second"), names, strict=True):
        await expect(dialog).to_contain_text(ordinal)
        await dialog.get_by_role("button", name=name, exact=True).click()
        await expect(dialog.get_by_text(f"{kind}: {ordinal}")).to_have_count(0)


async def conditions(page: Page, *values: str) -> None:
    await page.locator(".part").get_by_role("button", name="Conditions").click()
    dialog = page.get_by_role("dialog")
    for place, value in enumerate(values):
        await dialog.locator("input").nth(place).fill(value)
    await picture(page, "conditions")
    await dialog.get_by_role("button", name="Set").click()
    await expect(dialog).to_have_count(0)


async def tolerance(
    page: Page, name: str, figure: str, limits: tuple[float, float, float]
) -> None:
    row = page.locator(".part .feature", has_text=name)
    await expect(row).to_contain_text("±")
    await row.click()
    dialog = page.get_by_role("dialog")
    await dialog.get_by_role("button", name=f"Tolerance of {figure}").click()
    for field, value in zip(("Nominal", "Lower", "Upper"), limits, strict=True):
        await dialog.get_by_label(field).fill(str(value))
    await dialog.get_by_role("button", name="Set").click()
    await expect(dialog).to_have_count(0)


async def picture(page: Page, name: str) -> None:
    """Keep a picture where TRAVERSE_PICTURES names a folder."""
    folder = os.environ.get("TRAVERSE_PICTURES")
    if folder:
        await asyncio.sleep(0.3)
        await page.screenshot(path=f"{folder}/{name}.png")
