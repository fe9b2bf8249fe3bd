"""The sections of the page about the arm: parameters, correlations, what is weak."""

import numpy as np

from traverse.lab.identification.equations.probe_effect import probe_effects_mm
from traverse.lab.identification.report.map_picture import map_picture
from traverse.lab.identification.report.parameter_pictures import correlation_picture
from traverse.lab.identification.report.undetermined_effects import (
    undetermined_effects_mm,
)
from traverse.lab.identification.report.words import (
    combination,
    length_mm,
    map_sentence,
)
from traverse.lab.identification.results.result import Identification, ParameterEstimate
from traverse.lab.identification.volume.uncertainty_map import UncertaintyMap
from traverse.lab.report.html import (
    image,
    note,
    paragraph,
    section,
    table,
)

_MOST_PAIRS = 12
_CLOSE = 0.9
_NOTHING_FREE = "No parameter was free: only the artefacts were placed."
# Turns are shown in thousandths of a radian.
_SHOWN = {"rad": (1e3, "mrad")}


def parameter_section(result: Identification) -> str:
    """List the parameters with their uncertainties, also at the probe."""
    if not result.parameters:
        return section("parameters", "Parameters", paragraph(_NOTHING_FREE))
    stds = np.array([entry.std for entry in result.parameters])
    adjustment = result.adjustment
    effects_mm = probe_effects_mm(
        adjustment.network, adjustment.state.arm, np.diag(stds)
    )
    head = ["parameter", "unit", "change", "std", "std at the probe [mm]", "controlled"]
    rows = [
        _parameter_row(entry, float(effect_mm))
        for entry, effect_mm in zip(result.parameters, effects_mm, strict=True)
    ]
    free = set(adjustment.network.parameters.free_names)
    geometric = adjustment.network.parameters.of_geometry().names
    movable = (".axis.", ".link.")
    held = [n for n in geometric if n not in free and any(m in n for m in movable)]
    parts = []
    if held:
        parts.append(
            paragraph(
                f"Held at their design values, as datum or by wish: {', '.join(held)}."
            )
        )
    return section(
        "parameters",
        "Parameters",
        table(head, rows, texts=2),
        *parts,
        note(
            "Change: against the arm file as given. .axis.v, .axis.w: turn of the axis "
            "towards v and w; .link.v, .link.w: change of the link along them; both "
            "lie across the axis. std: standard deviation, scaled by sigma0 where "
            "that contradicts the noise upwards or the noise was estimated. At the "
            "probe: what this std alone does to the ball's centre, as a root mean "
            "square over postures in the travelled ranges (at least 120 degrees), the "
            "motion of the arm as a whole taken out; the whole uncertainty is not "
            "their sum, because parameters are correlated: see the map. "
            "Controlled: which part of what the data say about it no other parameter "
            "can take away. Values and std of single parameters depend on what is "
            "held; distances do not."
        ),
    )


def _parameter_row(entry: ParameterEstimate, effect_mm: float) -> list[str]:
    factor, unit = _SHOWN.get(entry.unit, (1.0, entry.unit))
    return [
        entry.name,
        unit,
        f"{factor * entry.value:+.4f}",
        f"{factor * entry.std:.4f}",
        f"{effect_mm:.4f}",
        f"{entry.controllability:.3f}",
    ]


def correlation_section(result: Identification) -> str:
    """Show correlations, the closest pairs by name."""
    if not result.parameters:
        return section("correlations", "Correlations", paragraph(_NOTHING_FREE))
    correlations = result.correlations
    names = [entry.name for entry in result.parameters]
    first, second = np.triu_indices(len(names), 1)
    sizes = np.abs(correlations[first, second])
    order = [at for at in np.argsort(-sizes)[:_MOST_PAIRS] if sizes[at] > _CLOSE]
    parts = [image(correlation_picture(result), "correlations of the parameters")]
    if order:
        rows = [
            [
                names[first[at]],
                names[second[at]],
                f"{correlations[first[at], second[at]]:+.3f}",
            ]
            for at in order
        ]
        parts.append(table(["parameter", "and", "correlation"], rows, texts=2))
        parts.append(
            note(
                f"Pairs above {_CLOSE}. Correlated parameters are badly known one by "
                "one, yet their sum may be known well; what counts is the map."
            )
        )
    else:
        parts.append(paragraph(f"No pair is correlated by more than {_CLOSE}."))
    return section("correlations", "Correlations", *parts)


def weakness_section(result: Identification) -> str:
    """Name what the data do not determine, or hardly, with the remedy."""
    parts = []
    if result.undetermined:
        parts += [
            paragraph("Not determined; held at the values of the arm file:"),
            table(
                ["combination", "why, and what to do", "at the probe, if off"],
                [
                    [combination(u.direction), u.why, length_mm(float(effect_mm))]
                    for u, effect_mm in zip(
                        result.undetermined,
                        undetermined_effects_mm(result),
                        strict=True,
                    )
                ],
                texts=2,
            ),
        ]
    else:
        parts.append(paragraph("Nothing that was asked is undetermined."))
    if result.weak:
        parts += [
            paragraph("Determined poorly:"),
            table(
                ["combination", "why, and what to do", "std at the probe"],
                [
                    [combination(w.direction), w.why, length_mm(w.probe_mm)]
                    for w in result.weak
                ],
                texts=2,
            ),
        ]
    else:
        parts.append(paragraph("Nothing is determined poorly."))
    parts.append(
        note(
            "Combinations in units of plausible deviations from a design (axes 20 "
            "mrad, links 5 mm). Undetermined: the data know it worse than the design "
            "does; at the probe: root mean square shift if the design is off by one "
            "such deviation. Poorly: known not five times better than that, or worth "
            "more than ten times the noise of a contact at the probe."
        )
    )
    return section("undetermined", "Undetermined and weak directions", *parts)


def map_section(result: Identification, found: UncertaintyMap, noise_mm: float) -> str:
    """Show the volumetric uncertainty."""
    if not result.parameters:
        return section("map", "Volumetric uncertainty", paragraph(_NOTHING_FREE))
    names = {
        "radial": f"{found.length_mm:.0f} mm, radially from the first axis",
        "tangential": f"{found.length_mm:.0f} mm, across, around the first axis",
        "axial": f"{found.length_mm:.0f} mm, along the first axis",
        "from reference": "from the reference to the place",
    }
    rows = [
        [
            names[name],
            str(figures.n_places),
            f"{figures.median_mm:.4f}",
            f"{figures.quantile_95_mm:.4f}",
            f"{figures.largest_mm:.4f}",
            "{:.0f}, {:.0f}".format(*figures.worst_place_mm),
        ]
        for name, figures in found.summary().items()
    ]
    head = [
        "distance",
        "places",
        "median [mm]",
        "95 % [mm]",
        "largest [mm]",
        "there: radius, height [mm]",
    ]
    x, y, z = found.reference_mm
    return section(
        "map",
        "Volumetric uncertainty",
        paragraph(map_sentence(result, found)),
        image(map_picture(found), "standard deviation of distances by place"),
        table(head, rows),
        paragraph(
            f"For comparison: the noise of readings and contacts adds "
            f"{length_mm(noise_mm)} to a distance between two single poses."
        ),
        note(
            "Standard deviation of a measured distance that comes from the identified "
            "parameters: it is the same in every repetition and averages out nowhere. "
            "Predicted from their covariance over postures within the travelled "
            "ranges, in a half plane through the first axis; grey: not reached. It "
            "does not depend on the datum. The reference is the middle of the volume, "
            f"at {x:.0f}, {y:.0f}, {z:.0f} mm. Undetermined directions count as known: "
            "where they matter, the truth is worse."
        ),
    )
