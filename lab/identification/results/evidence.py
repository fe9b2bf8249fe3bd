"""What the conditions of an identification look at, taken from its result."""

import numpy as np

from traverse.lab.artefacts.artefact import Artefact
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.results.undetermined import combination
from traverse.lab.outcomes.identification import (
    Direction,
    IdentificationEvidence,
    IdentificationOutcome,
    PosesAside,
    SharedDeviation,
    identification_outcome,
)
from traverse.lab.outcomes.identified import ContradictedCertificate
from traverse.lab.statistics.outlier_clusters import ExcludedCluster

# Of the reach: a bar that is shorter carries little of a length.
_LONG_BAR = 0.66


def outcome_of(result: Identification) -> IdentificationOutcome:
    """Judge a result."""
    return identification_outcome(evidence_of(result))


def evidence_of(result: Identification) -> IdentificationEvidence:
    """Collect the figures that the conditions of an identification look at."""
    campaign, serial = result.campaign, result.serial_noise
    lengths_mm = [
        float(np.sum(np.linalg.norm(links_mm, axis=1)))
        for links_mm in (
            result.adjustment.state.arm.geometry.links_mm,
            np.array([joint.link_mm for joint in result.design.joints]),
        )
    ]
    reach_mm = lengths_mm[0]
    turned = result.orientations
    shift, prior = result.contact_shift, campaign.prior
    travel_rad = np.ptp(campaign.poses.angles_rad, axis=0)
    return IdentificationEvidence(
        converged=result.converged,
        redundancy=result.redundancy,
        sigma0=result.sigma0,
        test=result.global_test,
        noise_stated=campaign.encoder_rad is not None
        and campaign.contact_mm is not None,
        samples_per_square=1.0 if serial is None else serial.samples_per_square,
        rms_mm=_misclosure_mm(result),
        reach_mm=reach_mm,
        changed=_largest_change(result),
        size=reach_mm / max(lengths_mm[1], 1e-9),
        travel_deg=float(np.degrees(np.max(travel_rad))),
        moving="" if result.converged else combination(result.moving),
        n_free=len(result.parameters),
        n_poses=len(campaign.poses),
        n_excluded=len(result.excluded),
        n_oriented=0 if turned is None else turned.n_measured,
        n_turned=0 if turned is None else len(turned.excluded),
        certificates=contradicted_certificates(result),
        shared=None
        if shift is None
        else SharedDeviation(
            shift.artefacts,
            shift.shift_mm,
            result.design.probe.radius_mm,
            shift.evidence,
        ),
        undetermined=_undetermined(result),
        weak=[
            Direction(combination(weak.direction), weak.probe_mm, weak.why)
            for weak in result.weak
        ],
        lost=[
            PosesAside(
                entry.artefact,
                entry.n_lost,
                entry.n_poses,
                "what is stated of it is not as the rest says, or the arm's model is "
                "wrong there.",
            )
            for entry in result.lost_poses
        ],
        clusters=[_cluster(result, entry) for entry in result.clusters],
        scale_touches=_scale_touches(campaign.artefacts, max(reach_mm, lengths_mm[1])),
        wrong_signs=result.wrong_signs,
        offsets_rad=dict(
            zip(campaign.joint_names, result.zero_offsets_rad.tolist(), strict=True)
        ),
        family=""
        if prior is None
        else _left_family(prior.contradicted, whole=not prior.names),
    )


def _misclosure_mm(result: Identification) -> float:
    """Size of misclosures: of the poses used, or the median of all if it is larger.

    Half of an artefact's poses may have been left out, and still nothing fit.
    """
    sizes_mm = np.sqrt(np.nansum(result.statistics.misclosures_mm**2, axis=1))
    return max(result.rms_after_mm, float(np.median(sizes_mm)))


def _largest_change(result: Identification) -> tuple[str, float]:
    """Name the parameter that is farthest from the design, in plausible deviations.

    Zeros and tools are not the design's, nor are effects.
    """
    parameters = result.adjustment.network.parameters
    changes = [
        (entry.name, abs(entry.value) / tolerance)
        for entry, tolerance in zip(
            result.parameters, parameters.free_tolerances.tolist(), strict=True
        )
        if ".axis." in entry.name or ".link." in entry.name
    ]
    return max(changes, key=lambda change: change[1], default=("", 0.0))


def _undetermined(result: Identification) -> list[Direction]:
    if not result.undetermined:
        return []
    effects_mm = result.undetermined_effects_mm.tolist()
    return [
        Direction(combination(e.direction), effect_mm, e.why, is_scale=e.is_scale)
        for e, effect_mm in zip(result.undetermined, effects_mm, strict=True)
    ]


def contradicted_certificates(
    result: Identification,
) -> tuple[ContradictedCertificate, ...]:
    """List the certificates that contradict the rest, with what was measured."""
    lengths = [result.length_of(e.artefact, e.name) for e in result.contradictions]
    return tuple(
        ContradictedCertificate(
            artefact=entry.artefact,
            length=entry.name,
            certified_mm=entry.certified_mm,
            value_mm=length.value_mm,
            std_mm=length.std_mm,
            sigmas=entry.evidence,
            or_else=entry.rivals,
        )
        for entry, length in zip(result.contradictions, lengths, strict=True)
    )


def _cluster(result: Identification, entry: ExcludedCluster) -> PosesAside:
    place = entry.cluster
    if place.artefact:
        where, may_be = f"on {place.artefact}", "it may have moved. They were left out."
    elif place.joint is None:
        unit = "" if result.campaign.time_is_order else " s"
        where = (
            f"between {place.low:.0f} and {place.high:.0f}{unit} of the campaign's time"
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
    return PosesAside(where, place.n_excluded, place.n_poses, may_be)


def _scale_touches(artefacts: tuple[Artefact, ...], reach_mm: float) -> str:
    """Say which touches of a campaign would make its scale known."""
    bar = (
        "a ball bar with a certified distance of its centres, "
        f"{_LONG_BAR * reach_mm:.0f} mm or longer, with five touches on each ball"
    )
    known = [entry.id for entry in artefacts if entry.kind in ("sphere", "ball_bar")]
    if known:
        return (
            f"Add a length standard: {bar}; or give the certified lengths of "
            f"{', '.join(known)} in campaign.toml."
        )
    return f"Add a length standard: {bar}; or hold the links where they are known."


def _left_family(contradicted: tuple[tuple[str, float], ...], *, whole: bool) -> str:
    if not contradicted:
        return ""
    names = ", ".join(
        f"{sigmas:.3g} standard deviations in {name}" for name, sigmas in contradicted
    )
    left = (
        "this arm is none of it, and nothing of it counts."
        if whole
        else "this arm left its family there, and its own poses alone count."
    )
    return f"The measurements contradict the family by {names}: {left}"
