"""What an identification says, in sentences; for the page and for terminals."""

from collections.abc import Mapping

import numpy as np

from traverse.lab.identification.report.undetermined_effects import (
    undetermined_effects_mm,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.volume.uncertainty_map import UncertaintyMap

# Ordinary standard deviations between which 95 % of a normal lie.
_TWO_SIDED = 1.96
_LEAST_REDUNDANCY = 30
_ZERO_FOUND_RAD = 1e-4
_BY_CHANCE = 0.001
_MOST_LINES = 12
_MOST_NAMES = 6


def sigma0_sentences(result: Identification) -> list[str]:
    """Say what sigma0 means for this result."""
    if not result.converged:
        return [
            "The adjustment did not converge: none of these figures may be used. Check "
            "the arm file (units, signs, zeros) and the features of the poses."
        ]
    if result.redundancy <= 0:
        return [
            "There are no more equations than unknowns (redundancy 0): nothing checks "
            "this result. Measure more poses."
        ]
    figures = f"sigma0 = {result.sigma0:.3g} with a redundancy of {result.redundancy}"
    return [_sigma0_sentence(result, figures), _power_sentence(result)]


def _sigma0_sentence(result: Identification, figures: str) -> str:
    test = result.global_test
    if test.noise_estimated:
        return (
            f"{figures}. The noise was estimated from the same residuals, so that "
            "sigma0 is 1 by construction and tests nothing; compare the estimated "
            "noise with what encoders and contacts should do."
        )
    said = f"{figures} (p = {probability(test.p_value)})"
    if test.passed:
        return (
            f"{said}: the residuals are as large as the given noise leads to expect. "
            "Arm model and noise agree with the measurements."
        )
    if result.sigma0 > 1.0:
        chance = (
            f" By chance {100.0 * test.p_value:.1g} % of campaigns are as far off."
            if test.p_value > _BY_CHANCE
            else ""
        )
        return (
            f"{said}: the residuals are {result.sigma0:.3g} times as large as the "
            "given noise explains. Either the noise was given too small, or the arm "
            "does something that axes and links do not describe: look for a pattern "
            f"in the residuals against the joints.{chance} All standard deviations "
            "here are scaled by sigma0."
        )
    return (
        f"{said}: the residuals are smaller than the given noise leads to expect: it "
        "was given too large, and so are all standard deviations here."
    )


def _power_sentence(result: Identification) -> str:
    serial = result.serial_noise
    shared = 1.0 if serial is None else serial.samples_per_square
    width = _TWO_SIDED / np.sqrt(2.0 * result.redundancy / shared)
    seen = f"by less than about {100.0 * width:.0f} % would not be noticed"
    if result.redundancy < _LEAST_REDUNDANCY:
        return (
            f"With so little redundancy noise that is wrong {seen}: a weak check. "
            "Measure more poses."
        )
    return f"With this redundancy noise that is wrong {seen}."


def rms_sentence(result: Identification) -> str:
    """Compare misclosures before and after."""
    return (
        f"Root mean square of the misclosures: {length_mm(result.rms_before_mm)} with "
        f"the arm file as given, {length_mm(result.rms_after_mm)} identified."
    )


def noise_sentence(result: Identification) -> str:
    """Say which noise was used."""
    encoders_urad = 1e6 * result.noise.encoder_rad
    least, largest = float(encoders_urad.min()), float(encoders_urad.max())
    readings = f"{least:.3g}" if least == largest else f"{least:.3g} to {largest:.3g}"
    contacts = sorted({entry.contact_mm for entry in result.artefacts})
    shown = " to ".join(
        length_mm(x) for x in dict.fromkeys((contacts[0], contacts[-1]))
    )
    whence = "estimated" if result.global_test.noise_estimated else "given or assumed"
    return f"Noise ({whence}): readings {readings} µrad, contacts {shown}."


def serial_sentence(result: Identification) -> str | None:
    """Say what neighbouring samples of a stream share."""
    serial = result.serial_noise
    if serial is None:
        return None
    return (
        f"Neighbouring samples of the stream share noise, which lasts "
        f"{1e3 * serial.lasts_s:.0f} ms: {serial.samples_per_mean:.3g} of them say as "
        "much as one. Standard deviations and the test of sigma0 allow for that."
    )


def determined_sentence(result: Identification) -> str:
    """Say how much of what was asked the data determine."""
    n_free, n_not = len(result.parameters), len(result.undetermined)
    if n_free == 0:
        return "No parameter was free: only the artefacts were placed."
    if n_not == 0:
        return f"All {n_free} free parameters are determined."
    rest = "one keeps its design value" if n_not == 1 else f"{n_not} keep design values"
    return (
        f"{n_free - n_not} of {n_free} combinations of the free parameters are "
        f"determined; {rest}."
    )


def map_sentence(result: Identification, found: UncertaintyMap) -> str:
    """Say how well distances are known, and when that is not all."""
    summary = found.summary()
    if not result.parameters:
        return "How well distances are known was not asked: no parameter was free."
    if not summary:
        return (
            "No distance could be reached within the travelled ranges: there is no map."
        )
    rows = list(summary.values())
    median_mm = float(np.median([row.median_mm for row in rows]))
    largest_mm = max(row.largest_mm for row in rows)
    said = (
        f"Standard deviation of a distance ({found.length_mm:.0f} mm long, or from the "
        f"middle of the volume): {length_mm(median_mm)} as a rule, "
        f"{length_mm(largest_mm)} at worst"
    )
    if not result.undetermined:
        return f"{said}."
    return f"{said}, if what is undetermined were as designed; the truth is worse."


def zeros_sentence(result: Identification) -> str | None:
    """Say which zeros the coarse search changed."""
    changed = [
        f"{name} by {offset_rad:+.4f} rad"
        for name, offset_rad in zip(
            result.campaign.joint_names, result.zero_offsets_rad, strict=True
        )
        if abs(offset_rad) > _ZERO_FOUND_RAD
    ]
    if not changed:
        return None
    return (
        "The arm file as given did not fit at all; other zeros do: "
        f"{', '.join(changed)}. Check the arm file."
    )


def combination(direction: Mapping[str, float]) -> str:
    """Write a combination of parameters, the largest first, not all of a long one."""
    largest = sorted(direction.items(), key=lambda entry: -abs(entry[1]))
    shown = ", ".join(f"{name} {value:+.2f}" for name, value in largest[:_MOST_NAMES])
    more = len(largest) - _MOST_NAMES
    return f"{shown} and {more} more" if more > 0 else shown


def summary_lines(result: Identification, found: UncertaintyMap) -> list[str]:
    """Say the most important things, a line each."""
    poses = result.campaign.poses
    lines = [
        f"{result.arm.name}: {counted(len(poses), 'pose')} at "
        f"{counted(len(result.artefacts), 'artefact')}",
        *sigma0_sentences(result),
    ]
    if not result.converged:
        return lines
    zeros = zeros_sentence(result)
    lines += [] if zeros is None else [zeros]
    serial = serial_sentence(result)
    lines += [
        rms_sentence(result),
        noise_sentence(result),
        *([] if serial is None else [serial]),
        determined_sentence(result),
    ]
    effects_mm = undetermined_effects_mm(result)
    for missing, effect_mm in zip(result.undetermined, effects_mm, strict=True):
        lines.append(
            f"undetermined: {combination(missing.direction)}: "
            f"{length_mm(float(effect_mm))} at the probe if the design is off by a "
            f"plausible deviation; {missing.why}"
        )
    for weak in result.weak[:_MOST_LINES]:
        lines.append(
            f"weak: {combination(weak.direction)}: {length_mm(weak.probe_mm)} at the "
            f"probe; {weak.why}"
        )
    if len(result.weak) > _MOST_LINES:
        lines.append(f"weak: and {len(result.weak) - _MOST_LINES} more combinations")
    lines += [
        f"{entry.id}: mean distance {length_mm(entry.mean_distance_mm)}"
        for entry in result.artefacts
        if entry.mean_distance_mm is not None
    ]
    lines.append(map_sentence(result, found))
    lines.append(excluded_sentence(result))
    return lines


def excluded_sentence(result: Identification) -> str:
    """Say who contradicts the others."""
    n_poses, excluded = len(result.campaign.poses), result.excluded
    if not excluded:
        return f"No pose of {n_poses} contradicts the others."
    numbers = ", ".join(str(entry.line) for entry in excluded[:_MOST_LINES])
    more = ", ..." if len(excluded) > _MOST_LINES else ""
    return (
        f"{len(excluded)} of {n_poses} poses contradict the others and were left out "
        f"(line {numbers}{more})."
    )


def length_mm(value_mm: float) -> str:
    """Write a length in mm with three digits, at least micrometres."""
    if not np.isfinite(value_mm):
        return f"{value_mm} mm"
    size = abs(value_mm)
    digits = 4 if size < 1.0 else 3 if size < 100.0 else 1
    if 0.0 < size < 0.001:
        return f"{value_mm:.2g} mm"
    return f"{value_mm:.{digits}f} mm"


def counted(number: int, noun: str) -> str:
    """Write a number with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def probability(p_value: float) -> str:
    """Write a probability."""
    return "below 0.0001" if p_value < 1e-4 else f"{p_value:.2g}"
