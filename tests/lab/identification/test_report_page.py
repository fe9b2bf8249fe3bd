"""The page of a report: complete, in one piece, true to the result."""

from datetime import UTC, datetime

import numpy as np
import pytest

from tests.lab.report.pages import Page
from tests.lab.simulated import DESIGN, DESIGN_ARM, bar, built, cones, simulate
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.report.page import report_page, result_map
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.uncertainty_map import UncertaintyMap
from traverse.lab.report.provenance import campaign_provenance

WHEN = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)

SECTIONS = [
    "verdict",
    "artefacts",
    "joints",
    "normal",
    "parameters",
    "undetermined",
    "map",
    "correlations",
    "excluded",
    "advice",
]


@pytest.fixture(scope="module")
def result() -> Identification:
    tables = [*cones(3), bar(id="bar <1> & co"), {"id": "ball", "kind": "sphere"}]
    tables.append(
        {
            "id": "grid",
            "kind": "points",
            "frame": "own",
            "points_mm": {"A": [0.0, 0.0, 0.0], "B": [90.0, 0.0, 0.0]},
        }
    )
    campaign = simulate(built(3), tables, 40, 7)
    campaign.poses.angles_rad[50, 1] += 3e-3
    return identify(campaign, DESIGN_ARM)


@pytest.fixture(scope="module")
def found(result: Identification) -> UncertaintyMap:
    return result_map(result)


@pytest.fixture(scope="module")
def text(result: Identification, found: UncertaintyMap) -> str:
    provenance = campaign_provenance(result.campaign, "C. Gauss", WHEN)
    return report_page(result, found, provenance)


def test_the_head_says_who_computed_what_and_when(page: Page) -> None:
    for said in (
        "2026-11-21 12:00:00 UTC by C. Gauss",
        "Traverse ",
        "Python ",
        "numpy ",
    ):
        assert said in page.text


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def test_every_section_is_there_and_can_be_jumped_to(page: Page) -> None:
    assert page.sections == SECTIONS
    assert {link.removeprefix("#") for link in page.links} == set(SECTIONS[1:])


def test_nothing_outside_is_referred_to(page: Page) -> None:
    page.check_is_self_contained()


def test_pictures_have_a_size_to_look_at(page: Page) -> None:
    assert len(page.images) == 6
    for png in page.pictures:
        width, height = (int.from_bytes(png[at : at + 4], "big") for at in (16, 20))
        assert 400 < width < 2000
        assert 150 < height < 2000


def test_every_parameter_and_artefact_has_a_row(
    page: Page, result: Identification
) -> None:
    for entry in result.parameters:
        at = page.cells.index(entry.name)
        factor = 1e3 if entry.unit == "rad" else 1.0
        assert page.cells[at + 1] == ("mrad" if entry.unit == "rad" else "mm")
        assert float(page.cells[at + 2]) == pytest.approx(
            factor * entry.value, abs=6e-5
        )
        assert float(page.cells[at + 3]) == pytest.approx(factor * entry.std, abs=6e-5)
    for artefact in result.artefacts:
        at = page.cells.index(artefact.id)
        assert page.cells[at + 3] == str(artefact.n_poses)
        assert page.cells[at + 4] == f"{artefact.rms_mm:.4f}"


def test_names_are_shown_and_never_read_as_markup(text: str, page: Page) -> None:
    assert "bar <1> & co" in page.cells
    assert "bar &lt;1&gt; &amp; co" in text


def test_excluded_poses_are_listed_with_their_line(
    page: Page, result: Identification
) -> None:
    assert [entry.line for entry in result.excluded] == [52]
    at = page.cells.index("52")
    assert page.cells[at - 2] == "cone-1"
    assert float(page.cells[at + 1]) == pytest.approx(result.excluded[0].w, abs=0.06)


def test_figures_of_the_verdict_are_those_of_the_result(
    page: Page, result: Identification, found: UncertaintyMap
) -> None:
    assert f"sigma0 = {result.sigma0:.3g}" in page.text
    assert f"redundancy of {result.redundancy}" in page.text
    worst_mm = max(figures.largest_mm for figures in found.summary().values())
    assert f"{worst_mm:.4f} mm at worst" in page.text


def test_suggested_poses_are_shown_in_degrees(
    page: Page, result: Identification
) -> None:
    assert result.suggestions
    entry = result.suggestions[0]
    row = [f"{np.degrees(angle):.0f}" for angle in entry.angles_rad]
    starts = [at for at, cell in enumerate(page.cells) if cell == row[0]]
    assert any(page.cells[at : at + len(row)] == row for at in starts)


def test_the_page_is_the_same_each_time(
    text: str, result: Identification, found: UncertaintyMap
) -> None:
    provenance = campaign_provenance(result.campaign, "C. Gauss", WHEN)
    assert report_page(result, found, provenance) == text


def test_a_page_without_free_parameters_says_so() -> None:
    campaign = simulate(DESIGN, cones(2), 10, 7)
    held = identify(campaign, DESIGN_ARM, Options(hold=("*",)))
    page = Page(report_page(held, result_map(held)))
    assert page.sections == SECTIONS
    assert page.text.count("No parameter was free") == 4
