"""What a report says in words, for good and bad results.

The page of a report: complete, in one piece, true to the result.
"""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.lab.identification.words import said
from tests.lab.report.pages import Page
from tests.lab.simulated import DESIGN, DESIGN_ARM, bar, built, cones, simulate
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.report.page import (
    WORDS,
    report_page,
    result_map,
    summary_lines,
)
from traverse.lab.identification.results.outcome import outcome_of
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.results.undetermined import combination
from traverse.lab.identification.uncertainty_map import UncertaintyMap
from traverse.lab.outcomes.base import State
from traverse.lab.outcomes.identified import ExcludedPose
from traverse.lab.report.quantities import length_mm, probability
from traverse.lab.statistics.distributions import GlobalTest

# A map is drawn up once for each result.
mapped = cache(result_map)


@pytest.fixture(scope="module")
def good() -> Identification:
    campaign = simulate(built(3), [*cones(3), bar()], 30, 7)
    return replace(
        identify(campaign, DESIGN_ARM),
        sigma0=1.02,
        redundancy=200,
        global_test=GlobalTest(p_value=0.6),
    )


@pytest.fixture(scope="module")
def scaleless() -> Identification:
    return identify(simulate(built(3), cones(4), 30, 7), DESIGN_ARM)


@pytest.mark.parametrize(
    ("sigma0", "test", "words"),
    [
        (
            1.02,
            GlobalTest(p_value=0.6),
            "consistent with the stated noise",
        ),
        (2.5, GlobalTest(p_value=1e-9), "2.5 times as large"),
        (2.5, GlobalTest(p_value=1e-9), "p = below 0.0001"),
        (
            1.1,
            GlobalTest(p_value=0.03),
            "By chance 3 % of campaigns",
        ),
        (
            0.4,
            GlobalTest(p_value=1e-9),
            "smaller than the stated noise",
        ),
        (1.0, GlobalTest(p_value=0.98, noise_estimated=True), "tests nothing"),
    ],
)
def test_sigma0_is_put_into_words(
    good: Identification, sigma0: float, test: GlobalTest, words: str
) -> None:
    result = replace(good, sigma0=sigma0, global_test=test)
    assert words in said(result)


def test_chance_is_not_named_where_it_is_out_of_the_question(
    good: Identification,
) -> None:
    result = replace(good, sigma0=3.0, global_test=GlobalTest(p_value=1e-20))
    assert "chance" not in said(result)


def test_little_redundancy_is_called_a_weak_check(good: Identification) -> None:
    # 1.96 / sqrt(2 redundancy): 49 % for 8, 9.8 % for 200.
    weak = said(replace(good, redundancy=8))
    assert "less than about 49 %" in weak
    assert "a weak check" in weak
    assert "less than about 10 %" in said(good)
    none = said(replace(good, redundancy=0))
    assert "nothing checks" in none


def test_without_convergence_no_figure_is_reported(good: Identification) -> None:
    lines = summary_lines(replace(good, converged=False), mapped(good))
    assert len(lines) == 3
    assert "did not converge" in lines[1]
    assert lines[2] == "verdict: Not identified (bad)"


def test_undetermined_scale_is_reported_where_distances_are(
    good: Identification, scaleless: Identification
) -> None:
    assert "plausible deviation" in WORDS.map(scaleless, mapped(scaleless))
    assert "plausible deviation" not in WORDS.map(good, mapped(good))
    lines = summary_lines(scaleless, mapped(scaleless))
    assert any(line.startswith("The scale of the arm is undet") for line in lines)
    assert any("one keeps its design value" in line for line in lines)


def test_changed_zeros_are_reported(good: Identification) -> None:
    offsets_rad = np.zeros(7)
    offsets_rad[2] = 0.25
    lines = summary_lines(replace(good, zero_offsets_rad=offsets_rad), mapped(good))
    assert any("J3 by +0.2500 rad" in line for line in lines)


def test_many_excluded_poses_are_counted_not_all_listed(good: Identification) -> None:
    excluded = tuple(ExcludedPose(line, 9.0) for line in range(2, 42))
    lines = summary_lines(replace(good, excluded=excluded), mapped(good))
    doubt, line = [line for line in lines if "contradict" in line]
    assert doubt.startswith("40 of 120 poses contradict the others and took no part. ")
    assert line.startswith("40 of 120 poses contradict")
    assert line.endswith("12, 13, ...).")


def test_noise_names_its_origin(good: Identification) -> None:
    assert WORDS.noise(good).startswith("Noise (stated): readings 5 µrad")
    estimated = replace(good, global_test=GlobalTest(p_value=1.0, noise_estimated=True))
    assert WORDS.noise(estimated).startswith("Noise (estimated)")


def test_long_combinations_are_cut_after_the_largest() -> None:
    direction = {f"J{k}.axis.v": (-1.0) ** k * k / 10.0 for k in range(1, 9)}
    assert combination(direction) == (
        "J8.axis.v +0.80, J7.axis.v -0.70, J6.axis.v +0.60, J5.axis.v -0.50, "
        "J4.axis.v +0.40, J3.axis.v -0.30 and 2 more"
    )


@pytest.mark.parametrize(
    ("value_mm", "text"),
    [
        (0.0, "0.0000 mm"),
        (0.00012, "0.00012 mm"),
        (0.00434, "0.0043 mm"),
        (12.3456, "12.346 mm"),
        (1234.56, "1234.6 mm"),
        (float("nan"), "nan mm"),
    ],
)
def test_lengths_have_digits_that_matter(value_mm: float, text: str) -> None:
    assert length_mm(value_mm) == text


def test_small_probabilities_are_not_spelled_out() -> None:
    assert (probability(3e-9), probability(0.312)) == ("below 0.0001", "0.31")


def test_an_undetermined_scale_is_no_clean_verdict(scaleless: Identification) -> None:
    judged = outcome_of(scaleless)
    assert judged.outcome.state is State.BAD
    assert not judged.writes_arm
    assert judged.title == "The scale of the arm is undetermined"
    reason = judged.outcome.reasons[0]
    assert reason.code == "scale"
    size_mm = scaleless.undetermined[0].probe_mm
    assert reason.values["probe_mm"] == pytest.approx(size_mm)
    assert "ball bar with a certified distance" in reason.remedy


@pytest.mark.parametrize(
    ("changed", "state", "title"),
    [
        ({}, "good", "Identified"),
        ({"converged": False}, "bad", "Not identified"),
        ({"redundancy": 0}, "bad", "Unchecked: no redundancy"),
        (
            {"sigma0": 2.5, "global_test": GlobalTest(p_value=1e-9)},
            "bad",
            "does not explain",
        ),
        (
            {"sigma0": 1.3, "global_test": GlobalTest(p_value=1e-9)},
            "doubt",
            "exceed the stated noise",
        ),
        ({"rms_after_mm": 50.0}, "bad", "does not explain"),
        ({"redundancy": 20}, "doubt", "reservations"),
        (
            {"sigma0": 1.1, "global_test": GlobalTest(p_value=0.03)},
            "doubt",
            "reservations",
        ),
        (
            {"global_test": GlobalTest(p_value=0.9, noise_estimated=True)},
            "doubt",
            "Identified, with reservations",
        ),
        ({"zero_offsets_rad": np.full(7, 0.1)}, "doubt", "with reservations"),
    ],
)
def test_only_a_tested_and_determined_result_is_good(
    good: Identification, changed: dict[str, Any], state: str, title: str
) -> None:
    result = replace(good, **{"undetermined": (), "weak": (), **changed})
    judged = outcome_of(result)
    assert judged.outcome.state == state
    assert title in judged.title


def test_undetermined_scale_is_worth_what_it_moves(scaleless: Identification) -> None:
    # A scale s shifts the probe by s x; what no rigid motion takes away of that is
    # s times the distance from the mean place.
    effect_mm = scaleless.undetermined[0].probe_mm
    network = scaleless.adjustment.network
    arm = scaleless.adjustment.state.arm
    _, centres_mm = network.posture_columns(arm)
    spread_mm = np.sqrt(centres_mm.var(axis=0).sum())
    # J2 carries 60 mm and, along the axis of J3, 500 mm: they grow by 5 mm and a part.
    (direction,) = scaleless.undetermined
    scale = abs(direction.direction["J2.link.v"]) * 5.0 / 560.0
    assert effect_mm == pytest.approx(scale * spread_mm, rel=0.02)


WHEN = datetime(2026, 11, 21, 12, 0, tzinfo=UTC)
SECTIONS = [
    "verdict",
    "artefacts",
    "joints",
    "normal",
    "parameters",
    "undetermined",
    "map",
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
def uncertainty(result: Identification) -> UncertaintyMap:
    return result_map(result)


@pytest.fixture(scope="module")
def text(result: Identification, uncertainty: UncertaintyMap) -> str:
    provenance = result.campaign.provenance("C. Gauss", WHEN)
    return report_page(result, uncertainty, provenance)


def test_the_head_says_who_computed_what_and_when(page: Page) -> None:
    for words in (
        "2026-11-21 12:00:00 UTC by C. Gauss",
        "Traverse ",
        "Python ",
        "numpy ",
    ):
        assert words in page.text


@pytest.fixture(scope="module")
def page(text: str) -> Page:
    return Page(text)


def test_every_section_is_there_and_can_be_jumped_to(page: Page) -> None:
    assert page.sections == SECTIONS
    assert {link.removeprefix("#") for link in page.links} == set(SECTIONS[1:])


def test_nothing_outside_is_referred_to(page: Page) -> None:
    page.check_is_self_contained()


def test_pictures_have_a_size_to_look_at(page: Page) -> None:
    assert len(page.images) == 5
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
    page: Page, result: Identification, uncertainty: UncertaintyMap
) -> None:
    assert f"sigma0 = {result.sigma0:.3g}" in page.text
    assert f"redundancy of {result.redundancy}" in page.text
    worst_mm = max(figures.largest_mm for figures in uncertainty.summary().values())
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
    text: str, result: Identification, uncertainty: UncertaintyMap
) -> None:
    provenance = result.campaign.provenance("C. Gauss", WHEN)
    assert report_page(result, uncertainty, provenance) == text


def test_a_page_without_free_parameters_says_so() -> None:
    campaign = simulate(DESIGN, cones(2), 10, 7)
    held = identify(campaign, DESIGN_ARM, Options(hold=("*",)))
    page = Page(report_page(held, result_map(held)))
    assert page.sections == SECTIONS
    assert page.text.count("No parameter was free") == 3
