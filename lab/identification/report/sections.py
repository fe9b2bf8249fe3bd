"""The sections of the page about measurements: residuals, exclusions, advice."""

import numpy as np

from traverse.lab.identification.report.parameter_pictures import coverage_picture
from traverse.lab.identification.report.residual_pictures import (
    against_normal,
    by_artefact,
    by_joint,
)
from traverse.lab.identification.report.words import excluded_sentence, length_mm
from traverse.lab.identification.results.result import ArtefactResult, Identification
from traverse.lab.report.html import (
    image,
    note,
    paragraph,
    section,
    table,
)

_MOST_ROWS = 200
_SMALL_CONTROLLABILITY = 0.1


def artefact_section(result: Identification) -> str:
    """Show residuals by artefact."""
    head = ["artefact", "kind", "lengths", "poses", "rms [mm]", "mean distance [mm]"]
    rows = [_artefact_row(entry) for entry in result.artefacts]
    return section(
        "artefacts",
        "Residuals by artefact",
        image(by_artefact(result), "misclosures of every artefact"),
        table(head, rows, texts=3),
        note(
            "A misclosure is what is left of a condition: three a touch of a cone or "
            "known point, one a touch of a surface. rms: root mean square of these "
            "scalars over the poses that took part. Lengths: as estimated, with "
            "standard deviation; where the other measurements can say it, without the "
            "certificate's own word."
        ),
    )


def _artefact_row(entry: ArtefactResult) -> list[str]:
    mean = entry.mean_distance_mm
    lengths = [
        f"{length.name.removesuffix('_mm')} {length.value_mm:.4f} ± "
        f"{length.std_mm:.4f} mm"
        for length in entry.lengths
    ]
    return [
        entry.id,
        entry.kind.replace("_", " "),
        "; ".join(lengths),
        str(entry.n_poses),
        f"{entry.rms_mm:.4f}",
        "" if mean is None else f"{mean:.4f}",
    ]


def joint_section(result: Identification) -> str:
    """Show residuals against every joint's angle."""
    return section(
        "joints",
        "Residuals against the joints",
        image(by_joint(result), "corrections of readings against readings"),
        note(
            "The correction that the adjustment gives to each reading. Red: means over "
            "parts of the range, with two standard errors. They should scatter about "
            "zero; a wave that repeats once a turn betrays an eccentric encoder, twice "
            "a turn a tilted one, a slope a wrong scale."
        ),
    )


def normal_section(result: Identification) -> str:
    """Show histogram and reliability."""
    taken = result.statistics.controllability[result.included]
    taken = taken[np.isfinite(taken)]
    found = result.statistics.detectable_mm[result.included]
    found = found[np.isfinite(found)]
    parts = []
    if len(taken) and len(found):
        weak = int(np.count_nonzero(taken < _SMALL_CONTROLLABILITY))
        parts.append(
            paragraph(
                f"Controllability of the poses: {np.median(taken):.2f} as a rule, "
                f"{taken.min():.2f} at least; {weak} of {len(taken)} poses have less "
                f"than {_SMALL_CONTROLLABILITY}. An error of one contact is found from "
                f"{length_mm(float(np.median(found)))} on as a rule, from "
                f"{length_mm(float(found.max()))} at worst (power 80 %, level 0.1 %)."
            )
        )
    return section(
        "normal",
        "Residuals against the normal distribution",
        image(against_normal(result), "histogram and quantiles of |w|"),
        *parts,
        note(
            "|w|: the test statistic of a pose as the absolute value of a standard "
            "normal with the same probability, here with the residuals divided by "
            "sigma0. Left: how often; right: sorted, against what is expected: a few "
            "poses far above the line are blunders, many of them another kind of "
            "error than noise. Controllability: which part of an error of "
            "the pose shows in its residuals."
        ),
    )


def excluded_section(result: Identification) -> str:
    """List the poses that contradict the others."""
    sentence = paragraph(excluded_sentence(result))
    if not result.excluded:
        return section("excluded", "Excluded observations", sentence)
    poses, campaign = result.campaign.poses, result.campaign
    places = {int(line): at for at, line in enumerate(poses.lines)}
    rows = []
    for entry in sorted(result.excluded, key=lambda pose: -pose.w)[:_MOST_ROWS]:
        at = places[entry.line]
        artefact = int(poses.artefacts[at])
        size_mm = float(np.sqrt(np.nansum(result.statistics.misclosures_mm[at] ** 2)))
        rows.append(
            [
                campaign.artefacts[artefact].id,
                campaign.feature_names[artefact][int(poses.features[at])],
                str(entry.line),
                f"{entry.w:.1f}",
                f"{size_mm:.4f}",
            ]
        )
    head = ["artefact", "feature", "line", "|w|", "misclosure [mm]"]
    more = len(result.excluded) - len(rows)
    return section(
        "excluded",
        "Excluded observations",
        sentence,
        table(head, rows, texts=2),
        *([paragraph(f"And {more} more, in residuals.csv.")] if more else []),
        note(
            f"Left out above |w| = {result.critical_w:.2f}. Line: of the table of "
            "poses, its header being line 1. A pose is left out of the adjustment "
            "only; look at what happened there before you believe it was a blunder."
        ),
    )


def advice_section(result: Identification) -> str:
    """Show coverage and the next poses."""
    parts = [
        image(coverage_picture(result), "how far every joint turned"),
        paragraph(
            f"Condition number of the arm's columns: {result.condition_number:.0f}. "
            "Up to about 30 the parameters are told apart well, above 1000 hardly."
        ),
    ]
    if result.suggestions:
        names = result.campaign.joint_names
        head = ["artefact", "feature", *(f"{name} [degrees]" for name in names), "left"]
        rows = [
            [
                entry.artefact,
                entry.feature,
                *(f"{np.degrees(angle):.0f}" for angle in entry.angles_rad),
                f"{100.0 * entry.variance_left:.0f} %",
            ]
            for entry in result.suggestions
        ]
        parts += [
            paragraph("These poses would help most, in this order:"),
            table(head, rows, texts=2),
            note(
                "Readings of the joints, at the artefacts where they stood. Left: part "
                "of the probe's present mean variance that remains after this pose and "
                "those before it."
            ),
        ]
    return section("advice", "Joint coverage and the next poses", *parts)
