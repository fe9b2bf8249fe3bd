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
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

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
    """

    artefacts: tuple[str, ...]
    shift_mm: float
    evidence: float


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
    certified = [dict(artefact.certified_lengths) for artefact in campaign.artefacts]
    shift: ContactShift | None = None
    shifted: tuple[ContactShift, Campaign, IteratedAdjustment] | None = None
    if _suspicious(campaign, run, design):
        shifted = _with_contacts_shifted(campaign, run, adjusted)
    while len(contradictions) < _MOST_WRONG and _suspicious(campaign, run, design):
        noise = run.adjustment.network.noise
        hypotheses = [
            (key, other, adjusted(other, noise))
            for key, other in _without_one(campaign)
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
        order = np.argsort(losses[1:])
        best = min(losses)
        if shifted is not None:
            loss = _loss(shifted[2], variance, design)
            if losses[0] - loss > _EVIDENCE and loss < best + _SAME:
                evidence = float(np.sqrt(losses[0] - loss))
                shift, campaign, run = (
                    replace(shifted[0], evidence=evidence),
                    *shifted[1:],
                )
                if estimated or not run.adjustment.converged:
                    run = adjusted(campaign, None)
                shifted = None
                continue
            shifted = None
        if losses[0] - best < _EVIDENCE:
            break
        (name, length, certified_mm), other, without = hypotheses[order[0]]
        certified_mm = _as_certified(campaign, certified, name, length)
        off_mm = abs(_length_mm(without, name, length) - certified_mm)
        gross = off_mm > _GROSS * certified_mm
        if not _is_to_blame(
            other, without, name, off_mm, gross=gross, estimated=estimated
        ):
            # Nothing else determines lengths, or the arm's model or noise is wrong.
            break
        campaign_before, campaign, run = campaign, other, without
        rivals = [
            f"{hypotheses[at][0][0]} {hypotheses[at][0][1]}"
            for at in order[1:]
            if losses[1 + at] - best < _SAME
        ]
        evidence = float(np.sqrt(losses[0] - best))
        if estimated or not run.adjustment.converged:
            run = adjusted(campaign, None)
        if shift is None and _is_the_only_radius(campaign_before, name, length):
            rivals.append(OF_CONTACTS)
        contradictions.append(
            ContradictedCertificate(
                artefact=name,
                length=length,
                certified_mm=certified_mm,
                sigmas=evidence,
                or_else=tuple(rivals),
            )
        )
    return campaign, run, tuple(contradictions), shift


# A rival of the only certified radius, which the measurements cannot tell from it.
OF_CONTACTS = "the probe's radius, its pretravel or the bending of the stylus"
# A shift by which a radius is compared with that of its artefact [mm].
_UNIT_MM = 1e-3


def _with_contacts_shifted(
    campaign: Campaign, run: IteratedAdjustment, adjusted: Adjust
) -> tuple[ContactShift, Campaign, IteratedAdjustment] | None:
    """Find the shift that several certified radii agree on; None with fewer than two.

    Strategy: with a shift d the certificates are R + d. The sum of squares S(d), all
    else adjusted, has its minimum where dS/dd = 2 sum v (dv/dd) / s^2 over the
    certificates is zero. That is nearly linear, so that its values at 0 and at the
    shift which a single linear step proposes give d by a secant.
    """
    names = tuple(
        artefact.id
        for artefact in campaign.artefacts
        if artefact.certified_lengths
        != artefact.with_contact_shift(_UNIT_MM).certified_lengths
    )
    if len(names) < 2:
        return None
    noise = run.adjustment.network.noise
    first, guess_mm = _slope(campaign, run)
    if guess_mm == 0.0:
        return None
    trial = _shifted(campaign, guess_mm)
    second = _slope(trial, adjusted(trial, noise))[0]
    if second == first:
        return None
    shift_mm = guess_mm * first / (first - second)
    other = _shifted(campaign, shift_mm)
    return ContactShift(names, shift_mm, 0.0), other, adjusted(other, noise)


def _slope(campaign: Campaign, run: IteratedAdjustment) -> tuple[float, float]:
    """Compute half of dS/dd at the campaign's certificates, and a step against it."""
    slope, steps_mm = 0.0, []
    network, unknowns = run.adjustment.network, run.adjustment.state.unknowns
    for station, of_station in zip(network.stations, unknowns, strict=True):
        artefact = campaign.artefacts[station.index]
        here = artefact.certificate(of_station, station.touches)
        beyond = artefact.with_contact_shift(_UNIT_MM).certificate(
            of_station, station.touches
        )
        if len(here.std_mm) == 0:
            continue
        known = np.isfinite(here.std_mm)
        change = (beyond.misclosures_mm - here.misclosures_mm)[known] / _UNIT_MM
        off_mm, std_mm = here.misclosures_mm[known], here.std_mm[known]
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


def _as_certified(
    campaign: Campaign, certified: list[dict[str, float]], name: str, length: str
) -> float:
    """Return a certified length as the campaign states it, without any shift."""
    places = [artefact.id for artefact in campaign.artefacts]
    return certified[places.index(name)][length]


def _is_the_only_radius(campaign: Campaign, name: str, length: str) -> bool:
    """Return whether a length is the only one that a shift of contacts changes."""
    changed = [
        (artefact.id, key)
        for artefact in campaign.artefacts
        for key, value_mm in artefact.certified_lengths.items()
        if artefact.with_contact_shift(_UNIT_MM).certified_lengths[key] != value_mm
    ]
    return changed == [(name, length)]


def _is_to_blame(
    campaign: Campaign,
    rest: IteratedAdjustment,
    name: str,
    off_mm: float,
    *,
    gross: bool,
    estimated: bool,
) -> bool:
    """Return whether the rest, without the certificate, is consistent and more precise.

    The certificate is off by so much from what the rest says; a length of an artefact
    of another name must remain, unless that is gross: no arm is wrong by as much, so
    that its file is a length as well. Where noise is estimated, sigma0 says nothing.
    """
    left_mm = rest.adjustment.network.rms_mm(rest.adjustment.state)
    beyond_model = off_mm > _BY_MODEL * left_mm
    if gross and beyond_model:
        return True
    agrees = beyond_model if estimated else rest.adjustment.sigma0 < _AGREEING
    others = [
        station
        for station in rest.adjustment.network.stations
        if station.artefact.id != name
    ]
    known = replace(rest.adjustment.network, stations=tuple(others)).has_length()
    return agrees and known and not lost_poses(campaign, rest)


def _length_mm(run: IteratedAdjustment, name: str, length: str) -> float:
    network, unknowns = run.adjustment.network, run.adjustment.state.unknowns
    return next(
        estimated.value_mm
        for station, state in zip(network.stations, unknowns, strict=True)
        if station.artefact.id == name
        for estimated in station.artefact.lengths(state)
        if estimated.name == length
    )


def _without_one(
    campaign: Campaign,
) -> Iterator[tuple[tuple[str, str, float], Campaign]]:
    """Leave out every certificate that there is, one at a time."""
    for index, artefact in enumerate(campaign.artefacts):
        for name, certified_mm in artefact.certified_lengths.items():
            changed = artefact.without_certificate(name)
            artefacts = list(campaign.artefacts)
            artefacts[index] = changed
            other = replace(campaign, artefacts=tuple(artefacts))
            yield (artefact.id, name, certified_mm), other


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
    for at, station in enumerate(adjustment.network.stations):
        unknowns = adjustment.state.unknowns[at]
        certificate = station.artefact.certificate(unknowns, station.touches)
        known = np.isfinite(certificate.std_mm)
        if not np.any(known) or station.artefact.kind == "points":
            continue
        elimination = adjustment.system.eliminations[at]
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
