"""Best fit of features: onto nominal places, or onto themselves from another station.

The features' errors are those of their touches, with what these share of the arm and
with touches that belong to several features, such as those of the plane of two bores.
A station is a place of the arm. An arm that is moved has the same errors of its
parameters at both stations, so these are shared by both sides of the fit.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.features.measured import Features
from traverse.kinematics.features.relations import SHAPES
from traverse.kinematics.fits.elements import PLACE, Element
from traverse.kinematics.helmert.adjustment import (
    AdjustedHelmert,
    HelmertError,
    adjusted_helmert,
    reliability_of,
)
from traverse.kinematics.helmert.shape import shape_of
from traverse.kinematics.helmert.symmetry import other_orders
from traverse.kinematics.helmert.transformation import Helmert, mirrored_share
from traverse.kinematics.helmert.volume import (
    Box,
    VolumeError,
    disposition_index,
    volume_error,
)
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.protocol.messages.fields import Vector

_ROUNDING_MM2 = 1e-8  # 0.1 um: a bore has no errors of its own across its plane
_MIRRORED = 0.1
_STRAIGHT = 0.15
_WORST_INDEX = 3.0
_NORMAL_95 = 1.645


@dataclass(frozen=True, slots=True, eq=False)
class BestFit:
    """A best fit of features, and what it is worth.

    Attributes:
        system: from the arm's to the part's, or to that of the first station.
        centre_mm: about which `covariance` is stated, in the system that it leads to.
        covariance: of shift and turn, (6, 6); without U, of unit weights.
        residuals_mm: nominal less fitted, by feature.
        sigma0: residuals over those that U lets expect; without U, in mm. None
            without redundancy.
        redundancy: coordinates less the six of the system.
        index: errors of places in the box around all touches of the part over those of
            one feature.
        error: of places there, one standard deviation; None where U is not known.
        doubts: why it is to be looked at before it is used.
    """

    system: Helmert
    centre_mm: Floats
    covariance: Floats
    residuals_mm: dict[str, Vector]
    sigma0: float | None
    redundancy: int
    index: VolumeError
    error: VolumeError | None
    doubts: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Places of features in one system.

    Attributes:
        covariances_mm2: (n, 3, 3).
        shared_mm: factors of what they share, (n, 3, rank), of both systems the same.
        touches_mm: what was touched there, (n_touches, 3).
    """

    places_mm: Floats
    covariances_mm2: Floats
    shared_mm: Floats
    touches_mm: Floats


def best_fit(
    features: Features,
    nominals_mm: Mapping[str, Vector],
    *,
    is_known: bool,
) -> BestFit:
    """Fit points and centres of features onto nominal places.

    Args:
        features: measured in the arm's system.
        nominals_mm: of at least three of them, by name, as long as the part is now.
        is_known: whether the errors of the touches are.

    Raises:
        ValueError: they do not determine the system; says what is left open.
    """
    measured = _places_of(features, list(nominals_mm))
    measured = replace(measured, touches_mm=features.errors.points_mm)
    nominal = _Places(
        np.array([*nominals_mm.values()]).reshape(-1, 3),
        np.tile(_ROUNDING_MM2 * np.eye(3), (len(nominals_mm), 1, 1)),
        np.zeros_like(measured.shared_mm),
        np.zeros((0, 3)),
    )
    return _fit(list(nominals_mm), measured, nominal, is_known=is_known)


def leapfrog_fit(
    features: Features, before_by_again: Mapping[str, str], *, is_known: bool
) -> BestFit:
    """Fit features that were touched from a new station onto those of before.

    Args:
        features: of both stations, each in the system of its own.
        before_by_again: names of the same feature, of at least three.
        is_known: whether the errors of the touches are.

    Raises:
        ValueError: they do not determine where the arm is now.
    """
    again, before = list(before_by_again), list(before_by_again.values())
    both, n = _places_of(features, [*again, *before]), len(again)
    new, old = (
        _Places(
            both.places_mm[rows],
            both.covariances_mm2[rows],
            both.shared_mm[rows],
            _touches_of(features, names),
        )
        for rows, names in ((slice(n), again), (slice(n, None), before))
    )
    return _fit(again, new, old, is_known=is_known)


def _fit(
    names: list[str], measured: _Places, onto: _Places, *, is_known: bool
) -> BestFit:
    from_mm, to_mm = measured.places_mm, onto.places_mm
    if is_known:
        adjusted = adjusted_helmert(
            from_mm,
            to_mm,
            measured.covariances_mm2,
            onto.covariances_mm2,
            from_shared_mm=measured.shared_mm,
            to_shared_mm=onto.shared_mm,
        )
    else:
        alike = np.tile(np.eye(3), (len(names), 1, 1))
        adjusted = adjusted_helmert(from_mm, to_mm, 0.0 * alike, alike)
    if mirrored_share(from_mm, to_mm) < _MIRRORED:
        raise HelmertError(
            "the features fit the mirror image of their nominal places far better: a "
            "sign of a coordinate is wrong, or places are exchanged"
        )
    touched_mm = adjusted.transformation.places_mm(measured.touches_mm)
    around_mm = np.concatenate([to_mm, touched_mm, onto.touches_mm])
    box = Box(around_mm.min(axis=0), around_mm.max(axis=0))
    index = disposition_index(to_mm, box)
    covariance = _trusted(adjusted)
    error = volume_error(box, adjusted.centre_mm, covariance) if is_known else None
    error_mm2 = np.sum(adjusted.misclosures_mm**2, axis=1)
    if is_known:
        errors_mm2 = measured.covariances_mm2 + onto.covariances_mm2
        error_mm2 = np.trace(errors_mm2, axis1=1, axis2=2)
    doubts = [
        *_doubts(adjusted, to_mm, index, is_known=is_known),
        *_other_order(names, to_mm, float(np.sqrt(np.mean(error_mm2)))),
    ]
    x_mm, y_mm, z_mm = adjusted.misclosures_mm.T.tolist()
    return BestFit(
        adjusted.transformation,
        adjusted.centre_mm,
        covariance,
        dict(zip(names, zip(x_mm, y_mm, z_mm, strict=True), strict=True)),
        adjusted.sigma0,
        adjusted.redundancy,
        index,
        error,
        tuple(doubts),
    )


def _places_of(features: Features, names: list[str]) -> _Places:
    """Return places with their errors.

    Raises:
        ValueError: a feature has no place, or was not measured.
    """
    elements = [_located(features, name) for name in names]
    if not elements:
        raise HelmertError("no feature has a place to be fitted onto")
    places_mm = np.array([element.place_mm for element in elements])
    covariances_mm2, shared_mm = _place_errors(elements, features.errors)
    return _Places(places_mm, covariances_mm2, shared_mm, np.zeros((0, 3)))


def _touches_of(features: Features, names: list[str]) -> Floats:
    weights = np.stack([features.elements[name].by_points[PLACE] for name in names])
    return features.errors.points_mm[np.any(weights != 0.0, axis=(0, 1, 3))]


def _located(features: Features, name: str) -> Element:
    """Return a feature that has a place.

    Raises:
        ValueError: it has none, or was not measured.
    """
    element = features.elements.get(name)
    if element is None:
        raise ValueError(f"{name}: {features.problems.get(name, 'not measured')}")
    if SHAPES[element.kind] != "point":
        raise ValueError(
            f"{name}: a {element.kind} has no place of its own; take points, circles, "
            "spheres"
        )
    return element


def _place_errors(
    elements: list[Element], errors: JointCovariance
) -> tuple[Floats, Floats]:
    """Compute covariances of places, (n, 3, 3), and what they share, (n, 3, rank)."""
    weights = np.stack([element.by_points[PLACE] for element in elements])
    propagated = [errors.combined(of_place) for of_place in weights]
    is_used = np.any(weights != 0.0, axis=(1, 3))
    common = np.flatnonzero(is_used.sum(axis=0) > 1)
    own_mm = np.linalg.cholesky(
        errors.own_mm2[common] + _ROUNDING_MM2 * np.eye(3)
    )  # of touches that several features have
    by_common = np.einsum("eqti,tij->eqtj", weights[:, :, common], own_mm)
    shared_mm = np.concatenate(
        [
            np.array([shared for _, shared in propagated]),
            by_common.reshape(len(elements), 3, -1),
        ],
        axis=2,
    )
    covariances_mm2 = np.array([covariance for covariance, _ in propagated])
    return covariances_mm2 + _ROUNDING_MM2 * np.eye(3), shared_mm


def _largest_sigma0(redundancy: int) -> float:
    """Bound sigma0 of right errors with 95 %: chi-squared by Wilson and Hilferty."""
    spread = 2.0 / (9.0 * redundancy)
    return float((1.0 - spread + _NORMAL_95 * np.sqrt(spread)) ** 1.5)


def _exceeds(adjusted: AdjustedHelmert) -> bool:
    sigma0 = adjusted.sigma0
    return sigma0 is not None and sigma0 > _largest_sigma0(adjusted.redundancy)


def _trusted(adjusted: AdjustedHelmert) -> Floats:
    """Return the covariance of the system; larger where the residuals are too large."""
    factor = (adjusted.sigma0 or 1.0) ** 2 if _exceeds(adjusted) else 1.0
    return factor * adjusted.cofactors


def _doubts(
    adjusted: AdjustedHelmert, nominal_mm: Floats, index: VolumeError, *, is_known: bool
) -> Iterator[str]:
    if not is_known:
        yield "U of the features is not known: nothing can be tested"
    elif _exceeds(adjusted):
        yield (
            f"residuals are {adjusted.sigma0:.1f} times what U lets expect: a feature "
            "is wrong, places are exchanged, or the part is not as drawn"
        )
    if np.any(reliability_of(adjusted).seen_per_mm2[:, 0] == 0.0):
        yield (
            "there are directions in which an error of a feature shows in no residual; "
            "take more features, not in one plane"
        )
    if shape_of(nominal_mm).straightness < _STRAIGHT:
        yield "the features are nearly on one line; take one far beside it"
    if index.max_mm > _WORST_INDEX:
        yield (
            f"at the worst touched place an error of a feature counts "
            f"{index.max_mm:.1f} times; take features farther apart"
        )


def _other_order(names: list[str], to_mm: Floats, error_mm: float) -> Iterator[str]:
    orders = other_orders(to_mm, error_mm)
    if orders:
        exchanged = ", ".join(
            f"{names[row]} as {names[place]}"
            for row, place in enumerate(orders[0].order.tolist())
            if row != place
        )
        yield (
            f"the features fit as well in another order ({exchanged}): nothing shows "
            "that each was touched under its own name; take one that breaks the "
            "symmetry"
        )
