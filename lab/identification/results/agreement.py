"""What must agree with the rest: certificates, artefacts, poses, arm file, family."""

import numpy as np

from traverse.lab.identification.results.result import Identification
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Shortfall,
    State,
    doubt,
)
from traverse.lab.outcomes.common_conditions import (
    few_excluded,
    is_many,
    like_family,
    no_repeats,
    signs_and_zeros,
)
from traverse.lab.outcomes.identified import ContradictedCertificate
from traverse.lab.statistics.outlier_clusters import ExcludedCluster

# Standard deviations within which a certificate is what was measured.
_AGREES = 3.0


def _certificates_agree(result: Identification) -> Finding:
    # One that was left out before another, which spoilt it, may be right after all.
    return [
        _contradicted(entry)
        for entry in result.contradictions
        if not abs(entry.value_mm - entry.certified_mm) <= _AGREES * entry.std_mm
    ] or Established()


def _contradicted(entry: ContradictedCertificate) -> Shortfall:
    text = (
        f"The certificate of {entry.artefact} contradicts everything else by "
        f"{entry.sigmas:.3g} sigma: it says {entry.length.removesuffix('_mm')} "
        f"{entry.certified_mm:.10g} mm, the measurements {entry.value_mm:.4f} ± "
        f"{entry.std_mm:.4f} mm. It was left out."
    )
    remedy = "Correct the campaign file and identify again."
    if entry.or_else:
        rivals = " or ".join(entry.or_else)
        text += (
            f" It may as well be {rivals} that is wrong: the measurements cannot tell."
        )
        remedy = "Find out which it is, correct the files and identify again."
    values = {
        "artefact": entry.artefact,
        "length": entry.length,
        "certified_mm": entry.certified_mm,
        "measured_mm": entry.value_mm,
        "std_mm": entry.std_mm,
        "sigmas": entry.sigmas,
        "rivals": list(entry.or_else),
    }
    return Shortfall(text, remedy, values, State.BAD)


def _radii_agree(result: Identification) -> Finding:
    shift, radius_mm = result.contact_shift, result.design.probe.radius_mm
    if shift is None:
        return Established()
    sense = "larger" if shift.shift_mm > 0.0 else "smaller"
    text = (
        f"The certified radii of {', '.join(shift.artefacts)} are all {sense} as "
        f"measured, by {1000.0 * abs(shift.shift_mm):.1f} µm: they have one cause "
        f"({shift.evidence:.3g} sigma), and none of them is to blame. The probe's "
        f"radius is not the stated {radius_mm:.10g} mm but "
        f"{radius_mm + shift.shift_mm:.4f} mm, or the contact is late or bends the "
        "stylus by as much (pretravel, force). The certificates took part, with this "
        "shift."
    )
    if shift.or_else:
        text += (
            f" Or the certified distances of {', '.join(shift.or_else)} are all wrong "
            f"by one factor, and the arm is {1e6 * abs(shift.other_scale):.0f} ppm "
            f"{'larger' if shift.other_scale > 0.0 else 'smaller'}: the measurements "
            "cannot tell, and its covariance counts both."
        )
    remedy = (
        "Calibrate the probe's radius on a sphere, with the force of measuring; look "
        "with traverse diagnose whether the stylus bends."
    )
    values = {
        "artefacts": list(shift.artefacts),
        "shift_mm": shift.shift_mm,
        "probe_radius_mm": radius_mm + shift.shift_mm,
        "sigmas": shift.evidence,
        "rivals": list(shift.or_else),
        "other_scale_ppm": 1e6 * shift.other_scale,
    }
    return doubt(text, remedy, values)


def _file_fits(result: Identification) -> Finding:
    offsets_rad = result.zero_offsets_rad.tolist()
    names = result.campaign.joint_names
    return signs_and_zeros(
        result.wrong_signs, dict(zip(names, offsets_rad, strict=True))
    )


def _artefacts_agree(result: Identification) -> Finding:
    return [
        Shortfall(
            f"{entry.artefact} lost {entry.n_lost} of {entry.n_poses} poses, more than "
            "a fifth: what is stated of it is not as the rest says, or the arm's model "
            "is wrong there.",
            "Check its features, lengths and place during the measurement, and which "
            "parameters are held.",
            {"artefact": entry.artefact, "n_lost": entry.n_lost, "n": entry.n_poses},
        )
        for entry in result.lost_poses
    ] or Established()


def _no_clusters(result: Identification) -> Finding:
    time_unit = "" if result.campaign.time_is_order else " s"
    return [_cluster(entry, time_unit) for entry in result.clusters] or Established()


def _cluster(entry: ExcludedCluster, time_unit: str) -> Shortfall:
    place = entry.cluster
    if place.artefact:
        where, may_be = f"on {place.artefact}", "it may have moved. They were left out."
    elif place.joint is None:
        where = (
            f"between {place.low:.0f} and {place.high:.0f}{time_unit} of the "
            "campaign's time"
        )
        may_be = "something may have moved then. They were left out."
    else:
        low_deg, high_deg = np.degrees([place.low, place.high])
        where = (
            f"where joint {place.joint} is at {low_deg:.3g} to {high_deg:.3g} degrees"
        )
        may_be = (
            "the arm does something there that its model lacks. They take part: the "
            "arm is fitted to all of its range, and the noise counts what is lacking."
            if entry.taken_back
            else "the arm may do something there that its model lacks. They were left "
            "out: blunders may lie there by chance."
        )
    return Shortfall(
        f"{place.n_excluded} poses that contradict the others lie together, among "
        f"{place.n_poses} {where}: {may_be}",
        "Look for it with traverse diagnose.",
        {"where": where, "n_excluded": place.n_excluded, "n": place.n_poses},
    )


def _family_agrees(result: Identification) -> Finding:
    prior = result.campaign.prior
    if prior is None:
        return Established()
    return like_family(prior.family, prior.contradicted, is_of_it=bool(prior.names))


def _few_excluded(result: Identification) -> Finding:
    return few_excluded(len(result.excluded), len(result.campaign.poses))


def _orientations_agree(result: Identification) -> Finding:
    turned = result.orientations
    n_turned = 0 if turned is None else len(turned.excluded)
    n_all = 0 if turned is None else turned.n_measured
    values = {"n_excluded": n_turned, "n": n_all}
    if not is_many(n_turned, n_all):
        return Established(values)
    text = (
        f"{n_turned} of {n_all} orientations contradict the positions and were left "
        "out."
    )
    remedy = (
        "Check the order of the quaternions' components (w, x, y, z), the frame that "
        "they are in, and that the instrument's probe stayed as it was mounted."
    )
    return doubt(text, remedy, values)


STATED = (
    Condition("certificates", "no certificate is contradicted", _certificates_agree),
    Condition("radii", "certified radii are as measured", _radii_agree),
    Condition("arm_file", "signs and zeros of the arm file fit", _file_fits),
)
"""What files state."""


def _independent(result: Identification) -> Finding:
    poses = result.campaign.poses
    n_repeated = 0 if result.campaign.is_stream else poses.n_repeated
    return no_repeats(n_repeated, len(poses))


KEPT = (
    Condition("artefacts", "no artefact lost many poses", _artefacts_agree),
    Condition("clusters", "excluded poses do not lie together", _no_clusters),
    Condition("repeated", "poses were measured anew", _independent),
)
"""Which poses count."""

ALIKE = (
    Condition("family", "the arm is of its family", _family_agrees),
    Condition("excluded", "few poses contradict the others", _few_excluded),
    Condition("orientations", "few orientations are left out", _orientations_agree),
)
"""Arms of the family, and most poses."""
