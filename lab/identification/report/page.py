"""The page: everything about an identification in one file without references."""

from pathlib import Path

import numpy as np

from traverse.lab.identification.report.parameter_sections import (
    correlation_section,
    map_section,
    parameter_section,
    weakness_section,
)
from traverse.lab.identification.report.sections import (
    advice_section,
    artefact_section,
    excluded_section,
    joint_section,
    normal_section,
)
from traverse.lab.identification.report.words import (
    counted,
    determined_sentence,
    excluded_sentence,
    map_sentence,
    noise_sentence,
    rms_sentence,
    serial_sentence,
    sigma0_sentences,
    zeros_sentence,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.volume.distance_deviations import (
    arm_uncertainty,
    noise_deviations_mm,
)
from traverse.lab.identification.volume.uncertainty_map import (
    UncertaintyMap,
    uncertainty_map,
)
from traverse.lab.report.html import note, paragraph, section
from traverse.lab.report.page_frame import framed, navigation
from traverse.strict_toml.writing import write_atomically

_CONTENTS = {
    "artefacts": "artefacts",
    "joints": "joints",
    "normal": "distribution",
    "parameters": "parameters",
    "undetermined": "undetermined and weak",
    "map": "volumetric uncertainty",
    "correlations": "correlations",
    "excluded": "excluded",
    "advice": "next poses",
}
_SEED = 4
_N_PAIRS = 200


def result_map(result: Identification) -> UncertaintyMap:
    """Draw up the uncertainty map of a result."""
    adjustment = result.adjustment
    arm = arm_uncertainty(
        adjustment.state.arm, adjustment.network.parameters, result.covariance
    )
    return uncertainty_map(arm, result.campaign.poses.angles_rad[result.included])


def write_report(result: Identification, found: UncertaintyMap, path: Path) -> None:
    """Write the page in place of an old one, whole or not at all."""
    write_atomically(path, report_page(result, found))


def report_page(result: Identification, found: UncertaintyMap) -> str:
    """Make the page; the text is complete in itself."""
    parts = [
        note(_provenance(result)),
        navigation(_CONTENTS),
        _verdict(result, found),
        artefact_section(result),
        joint_section(result),
        normal_section(result),
        parameter_section(result),
        weakness_section(result),
        map_section(result, found, _noise_mm(result)),
        correlation_section(result),
        excluded_section(result),
        advice_section(result),
    ]
    return framed(f"Identification of {result.arm.name}", parts)


def _provenance(result: Identification) -> str:
    campaign = result.campaign
    started = (
        "" if campaign.start_utc is None else f", begun {campaign.start_utc:%F %T}"
    )
    digest = f", SHA-256 {campaign.digest[:12]}" if campaign.digest else ""
    return (
        f"Campaign of {counted(len(campaign.poses), 'pose')} at "
        f"{counted(len(result.artefacts), 'artefact')}{started}{digest}; "
        f"{counted(len(campaign.joint_names), 'joint')}; "
        f"{counted(len(result.iterations), 'iteration')}."
    )


def _verdict(result: Identification, found: UncertaintyMap) -> str:
    test = result.global_test
    # Less noise than was given does no harm.
    as_expected = test.passed or test.noise_estimated or result.sigma0 < 1.0
    good = result.converged and as_expected
    zeros, serial = zeros_sentence(result), serial_sentence(result)
    sentences = [
        *sigma0_sentences(result),
        *([] if zeros is None else [zeros]),
        rms_sentence(result),
        noise_sentence(result),
        *([] if serial is None else [serial]),
        determined_sentence(result),
        excluded_sentence(result),
        map_sentence(result, found),
    ]
    kind = "verdict" if good else "verdict bad"
    text = "\n".join(paragraph(sentence) for sentence in sentences)
    return section("verdict", "Verdict", f'<div class="{kind}">{text}</div>')


def _noise_mm(result: Identification) -> float:
    """What noise adds to the distance of two single poses, as a rule."""
    taken = np.flatnonzero(result.included)
    if len(taken) < 2:
        return float("nan")
    rng = np.random.default_rng(_SEED)
    pairs = rng.choice(len(taken), (_N_PAIRS, 2))
    pairs = taken[pairs[pairs[:, 0] != pairs[:, 1]]]
    angles_rad = result.campaign.poses.angles_rad
    contact_mm = float(np.median([entry.contact_mm for entry in result.artefacts]))
    deviations_mm = noise_deviations_mm(
        result.adjustment.state.arm.geometry,
        result.noise.encoder_rad,
        contact_mm,
        angles_rad[pairs[:, 0]],
        angles_rad[pairs[:, 1]],
    )
    return float(np.median(deviations_mm))
