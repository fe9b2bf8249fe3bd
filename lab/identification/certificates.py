"""Certificates that contradict the rest, and what all radii have in common.

Artefacts are tested before their poses.

If an artefact lost many poses, or its certified length is far from what the others
say, every certificate is left out in turn and the campaign is adjusted anew (a
generalised likelihood ratio with the certificate's value free). The loss of a
hypothesis is

    sum over all poses of min(statistic, 16) + squared changes of the arm in plausible
    deviations from its design

with one noise for all: a pose counts as a blunder at four standard
deviations, whether it took part or not. Leaving out a certificate frees one value, so
that a loss that is smaller by 30 is 5.5 standard deviations of evidence.

What shifts every contact along its normal, a wrong radius of the probe, pretravel, or
a stylus that bends, makes all certified radii look wrong by as much. It is tried before
any certificate is accused: one shift for all, which frees one value as well.

Distances that are all wrong by one factor give the arm another scale, and then right
radii look wrong. So all distances are left out together, too, and are accused where
that explains more than any one cause does; where it explains as much as a shift of the
contacts, it is named beside it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from traverse.lab.adjustment import ArmValues, IteratedAdjustment, Noise
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.outcomes.identified import ContradictedCertificate

# An artefact that lost more of its poses than this is suspect.
LARGE_PART = 0.2
_FEW_POSES = 3
# Standard deviations between a certificate and what the others say.
_FAR = 5.0
# How many times one artefact's contacts are as noisy as another's.
_NOISY = 5.0
_BLUNDER = 16.0
_EVIDENCE = 30.0
# sigma0 up to which the rest agrees with itself.
_AGREEING = 2.0
# What a wrong model does to a length is less than so many root mean squares of the
# misclosures that are left; and no arm is wrong by this part of a length.
_BY_MODEL = 10.0
_GROSS = 0.1
# Hypotheses whose losses differ by less explain the campaign equally well.
_SAME = 10.0
_MOST_WRONG = 3
# Root mean square change of the arm, in plausible deviations, that no design explains.
_FAR_FROM_DESIGN = 5.0
# Adjusts a campaign, with a noise or with what it estimates.
Adjust = Callable[[Campaign, Noise | None], IteratedAdjustment]


@dataclass(frozen=True, slots=True)
class ContactShift:
    """A shift along the normal that the contacts with all certified radii share.

    Attributes:
        artefacts: Whose certified lengths it changes.
        shift_mm: As if the radius of the probe were larger by as much.
        evidence: Standard deviations by which the campaign fits better with it.
        or_else: Artefacts whose distances, all wrong by one factor, explain as much.
        other_scale: By which part of itself the arm is larger then.
    """

    artefacts: tuple[str, ...]
    shift_mm: float
    evidence: float
    or_else: tuple[str, ...] = ()
    other_scale: float = 0.0


class CertifiedLength(NamedTuple):
    """A length of an artefact, as certified."""

    artefact: str
    name: str
    certified_mm: float


@dataclass(frozen=True, slots=True)
class LostPoses:
    """An artefact that lost more than a fifth of its poses: id, lost, all."""

    artefact: str
    n_lost: int
    n_poses: int


def lost_poses(campaign: Campaign, run: IteratedAdjustment) -> tuple[LostPoses, ...]:
    """List the artefacts that lost many of their poses."""
    lost = []
    for index, artefact in enumerate(campaign.artefacts):
        mine = campaign.poses.artefacts == index
        n_poses = int(np.count_nonzero(mine))
        n_lost = int(np.count_nonzero(mine & ~run.included))
        if n_lost >= _FEW_POSES and n_lost > LARGE_PART * n_poses:
            lost.append(LostPoses(artefact.id, n_lost, n_poses))
    return tuple(lost)


def without_wrong_certificates(
    campaign: Campaign, run: IteratedAdjustment, adjusted: Adjust, design: ArmValues
) -> tuple[
    Campaign,
    IteratedAdjustment,
    tuple[ContradictedCertificate, ...],
    ContactShift | None,
]:
    """Leave out the certificates that contradict everything else, the worst first.

    The run is one with all certificates; where the campaign does not decide, the design
    does. Returns the campaign without them, adjusted, which they are, and the shift of
    the contacts that was allowed for before.
    """
    contradictions: list[ContradictedCertificate] = []
    estimated = run.noise_estimated
    certified = {entry.id: entry.certified_lengths for entry in campaign.artefacts}
    shift: ContactShift | None = None
    shifted: tuple[ContactShift, Campaign, IteratedAdjustment] | None = None
    if _suspicious(campaign, run, design):
        shifted = _with_contacts_shifted(campaign, run, adjusted)
    while len(contradictions) < _MOST_WRONG and _suspicious(campaign, run, design):
        noise = run.adjustment.network.noise
        hypotheses = [
            (lengths, other, adjusted(other, noise))
            for lengths, other in _without_some(campaign)
        ]
        runs = [run, *(trial for _, _, trial in hypotheses)]
        # An arm that shrank to nothing fits everything: its noise is none.
        scales = [
            trial.statistics.robust_scale
            for trial in runs
            if not _far_from_design(trial, design)
        ]
        least = 0.01 if estimated else 1.0
        variance = max(min(scales, default=1.0), least) ** 2
        losses = [_loss(trial, variance, design) for trial in runs]
        # Several certificates are accused only by what none alone explains.
        losses[1:] = [
            loss + _SAME * (len(lengths) > 1)
            for loss, (lengths, _, _) in zip(losses[1:], hypotheses, strict=True)
        ]
        order = np.argsort(losses[1:])
        best = min(losses)
        if shifted is not None:
            loss = _loss(shifted[2], variance, design)
            if losses[0] - loss > _EVIDENCE and loss < best + _SAME:
                shift, campaign, run = shifted
                shift = replace(shift, evidence=float(np.sqrt(losses[0] - loss)))
                for (lengths, _, trial), other in zip(
                    hypotheses, losses[1:], strict=True
                ):
                    if len(lengths) > 1 and other < loss + 2.0 * _SAME:
                        shift = replace(
                            shift,
                            or_else=tuple(length.artefact for length in lengths),
                            other_scale=trial.size / run.size - 1.0,
                        )
                if estimated or not run.adjustment.converged:
                    run = adjusted(campaign, None)
                shifted = None
                continue
            shifted = None
        if losses[0] - best < _EVIDENCE:
            break
        accused, other, without = hypotheses[order[0]]
        # As the campaign states it, without any shift.
        accused = tuple(
            length._replace(certified_mm=certified[length.artefact][length.name])
            for length in accused
        )
        if not _are_to_blame(other, without, accused, estimated=estimated):
            # Nothing else determines lengths, or the arm's model or noise is wrong.
            break
        radii = _radii(campaign)
        campaign, run = other, without
        rivals = [
            f"{length.artefact} {length.name}"
            for index in order[1:]
            if losses[1 + index] - best < _SAME and len(hypotheses[index][0]) == 1
            for length in hypotheses[index][0]
        ]
        if estimated or not run.adjustment.converged:
            run = adjusted(campaign, None)
        if len(accused) > 1:
            rivals = [OF_RADII]
        elif shift is None and radii == [(accused[0].artefact, accused[0].name)]:
            rivals.append(OF_CONTACTS)
        contradictions += [
            ContradictedCertificate(
                artefact=length.artefact,
                length=length.name,
                certified_mm=length.certified_mm,
                sigmas=float(np.sqrt(losses[0] - best)),
                or_else=tuple(rivals),
            )
            for length in accused
        ]
    return campaign, run, tuple(contradictions), shift


# A rival of the only certified radius, which the measurements cannot tell from it.
OF_CONTACTS = "the probe's radius, its pretravel or the bending of the stylus"
# A rival of all distances.
OF_RADII = "the probe's radius together with certified radii"
# A shift by which a radius is compared with that of its artefact [mm].
_UNIT_MM = 1e-3
# Until a secant changes the shift by less than this part of it.
_MOST_SECANTS = 6
_SMALL_STEP = 0.02


def _with_contacts_shifted(
    campaign: Campaign, run: IteratedAdjustment, adjusted: Adjust
) -> tuple[ContactShift, Campaign, IteratedAdjustment] | None:
    """Find the shift that several certified radii agree on; None with fewer than two.

    Strategy: with a shift d the certificates are R + d. The sum of squares S(d), all
    else adjusted, has its minimum where dS/dd = 2 sum v (dv/dd) / s^2 over the
    certificates is zero. That is nearly linear while the same poses take part, so that
    secants from 0 and the shift which a single linear step proposes give d.
    """
    names = tuple(entry.id for entry in campaign.artefacts if entry.certified_radii)
    if len(names) < 2:
        return None
    noise = run.adjustment.network.noise
    last_mm = 0.0
    last_slope, shift_mm = _slope(campaign, run)
    if shift_mm == 0.0:
        return None
    for _ in range(_MOST_SECANTS):
        trial = _shifted(campaign, shift_mm)
        trial_run = adjusted(trial, noise)
        slope = _slope(trial, trial_run)[0]
        if slope == last_slope:
            return None
        step_mm = slope * (shift_mm - last_mm) / (last_slope - slope)
        if abs(step_mm) < _SMALL_STEP * abs(shift_mm):
            break
        last_mm, last_slope, shift_mm = shift_mm, slope, shift_mm + step_mm
    return ContactShift(names, shift_mm, 0.0), trial, trial_run


def _slope(campaign: Campaign, run: IteratedAdjustment) -> tuple[float, float]:
    """Compute half of dS/dd at the campaign's certificates, and a step against it."""
    slope, steps_mm = 0.0, []
    network, unknowns = run.adjustment.network, run.adjustment.state.unknowns
    for station, of_station in zip(network.stations, unknowns, strict=True):
        artefact = campaign.artefacts[station.index]
        certificate = artefact.certificate(of_station, station.touches)
        beyond = artefact.with_contact_shift(_UNIT_MM).certificate(
            of_station, station.touches
        )
        if len(certificate.std_mm) == 0:
            continue
        known = np.isfinite(certificate.std_mm)
        change = (beyond.misclosures_mm - certificate.misclosures_mm)[known] / _UNIT_MM
        off_mm, std_mm = certificate.misclosures_mm[known], certificate.std_mm[known]
        slope += float(np.sum(off_mm * change / std_mm**2))
        moves = change != 0.0
        steps_mm += (-off_mm[moves] / change[moves]).tolist()
    # A certificate takes up a part only of what it is off by: any step in that sense.
    return slope, float(np.mean(steps_mm)) if steps_mm else 0.0


def _shifted(campaign: Campaign, shift_mm: float) -> Campaign:
    artefacts = [
        artefact.with_contact_shift(shift_mm) for artefact in campaign.artefacts
    ]
    return replace(campaign, artefacts=tuple(artefacts))


def _radii(campaign: Campaign) -> list[tuple[str, str]]:
    """List the certified lengths that a shift of contacts changes."""
    return [
        (artefact.id, name)
        for artefact in campaign.artefacts
        for name in artefact.certified_radii
    ]


def _are_to_blame(
    campaign: Campaign,
    run_without: IteratedAdjustment,
    accused: Sequence[CertifiedLength],
    *,
    estimated: bool,
) -> bool:
    """Return whether the rest without them is consistent and more precise.

    A length of an artefact of another name must remain, unless one is off by so much
    that no arm is, so that its file is a length as well. Where noise is estimated,
    sigma0 says nothing.
    """
    left_mm = run_without.adjustment.network.rms_mm(run_without.adjustment.state)
    offs = [
        (
            abs(_length_mm(run_without, length) - length.certified_mm),
            length.certified_mm,
        )
        for length in accused
    ]
    beyond_model = any(off_mm > _BY_MODEL * left_mm for off_mm, _ in offs)
    gross = any(off_mm > _GROSS * certified_mm for off_mm, certified_mm in offs)
    if gross and beyond_model:
        return True
    agrees = beyond_model if estimated else run_without.adjustment.sigma0 < _AGREEING
    names = {length.artefact for length in accused}
    not_accused = [
        station
        for station in run_without.adjustment.network.stations
        if station.artefact.id not in names
    ]
    known = replace(
        run_without.adjustment.network, stations=tuple(not_accused)
    ).has_length()
    return agrees and known and not lost_poses(campaign, run_without)


def _length_mm(run: IteratedAdjustment, length: CertifiedLength) -> float:
    network, unknowns = run.adjustment.network, run.adjustment.state.unknowns
    return next(
        estimated.value_mm
        for station, state in zip(network.stations, unknowns, strict=True)
        if station.artefact.id == length.artefact
        for estimated in station.artefact.lengths(state)
        if estimated.name == length.name
    )


def _without_some(
    campaign: Campaign,
) -> Iterator[tuple[tuple[CertifiedLength, ...], Campaign]]:
    """Leave out every certificate that there is, one at a time; then all distances."""
    lengths = [
        CertifiedLength(artefact.id, name, certified_mm)
        for artefact in campaign.artefacts
        for name, certified_mm in artefact.certified_lengths.items()
    ]
    radii = _radii(campaign)
    distances = [length for length in lengths if length[:2] not in radii]
    choices: list[tuple[CertifiedLength, ...]] = [(length,) for length in lengths]
    if radii and len(distances) > 1:
        choices.append(tuple(distances))
    for chosen in choices:
        artefacts = {entry.id: entry for entry in campaign.artefacts}
        for length in chosen:
            artefact = artefacts[length.artefact]
            artefacts[length.artefact] = artefact.without_certificate(length.name)
        yield chosen, replace(campaign, artefacts=tuple(artefacts.values()))


def _suspicious(campaign: Campaign, run: IteratedAdjustment, design: ArmValues) -> bool:
    noise_mm = run.adjustment.network.noise.contact_mm
    # Where noise is estimated, that of a kind takes the contradiction up.
    return (
        bool(np.max(noise_mm) > _NOISY * np.min(noise_mm))
        or _far_from_design(run, design)
        or bool(lost_poses(campaign, run))
        or _farthest(run) > _FAR
    )


def _far_from_design(run: IteratedAdjustment, design: ArmValues) -> bool:
    changes = run.adjustment.changes(design)
    return bool(np.sum(changes**2) > _FAR_FROM_DESIGN**2 * len(changes))


def _farthest(run: IteratedAdjustment) -> float:
    """Standard deviations of the certified value that fits worst."""
    adjustment, farthest = run.adjustment, 0.0
    for index, station in enumerate(adjustment.network.stations):
        unknowns = adjustment.state.unknowns[index]
        certificate = station.artefact.certificate(unknowns, station.touches)
        known = np.isfinite(certificate.std_mm)
        if not np.any(known) or station.artefact.kind == "points":
            continue
        elimination = adjustment.system.eliminations[index]
        std_mm = certificate.std_mm[known, np.newaxis]
        by_unknowns = certificate.by_unknowns[known] @ elimination.gain
        arm = by_unknowns @ elimination.left @ adjustment.split.inverse
        variances = np.sum(by_unknowns**2, axis=1) + np.sum(arm**2, axis=1)
        used = variances[:, np.newaxis] / std_mm**2
        white = certificate.misclosures_mm[known, np.newaxis] / std_mm
        free = np.maximum(1.0 - used, 0.0)
        tests = np.abs(white) / np.sqrt(np.where(free > 1e-9, free, np.inf))
        farthest = max(farthest, float(np.max(tests)))
    return farthest / max(run.statistics.robust_scale, 1.0)


def _loss(run: IteratedAdjustment, variance: float, design: ArmValues) -> float:
    statistics = np.nan_to_num(run.statistics.statistics, nan=np.inf) / variance
    changes = run.adjustment.changes(design)
    return float(np.sum(np.minimum(statistics, _BLUNDER)) + np.sum(changes**2))
