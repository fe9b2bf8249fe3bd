"""The Helmert transformation with errors on both sides: a Gauss-Helmert adjustment.

Wanted are the transformation and corrections v of all coordinates of both systems with

    to + v_to = T(from + v_from),    sum of v' C^-1 v = least.

For a given T the corrections are known: with the misclosure w = to - T(from) and its
covariance S = C_to + s^2 R C_from R', v_from = s C_from R' S^-1 w and v_to = -C_to S^-1
w, and what they cost is w' S^-1 w. T then moves by xi = (J' S^-1 J)^-1 J' S^-1 w, where
J is taken at the corrected place T(from + v_from): with J there, and not at T(from), xi
vanishes exactly where that sum is least (total least squares, no bias by S).

Errors of an arm's parameters are the same for all its points. With factors F of them,
of both sides by the same parameters, S = D + G G': D in blocks of the points, G = F_to
- s R F_from. Nothing larger than the rank of F is inverted (M. A. Woodbury, 1950):

    S^-1 = D^-1 - D^-1 G (I + G' D^-1 G)^-1 G' D^-1

Reliability is after W. Baarda (1968). An error e of point i enters the residuals
through B = P - P J Q J' P, the block of point i (P = S^-1): the noncentrality that it
gives to a test is e'B e. What B does not see stays in the transformation: it moves by
Q J' P e.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.shape import (
    Shape,
    direction_text,
    shape_of,
    undetermined,
)
from traverse.kinematics.helmert.transformation import (
    N_RIGID,
    Helmert,
    closed_helmert,
    motions,
)
from traverse.kinematics.model.quaternion import rotation_matrix, small_turn

_MOST_STEPS = 100
_SMALL_STEP = 1e-12  # of the points' extent
_SMALL_ENOUGH = 1e-7
_STRAIGHT = 0.1  # of their length
_ASTRAY = 3.0  # the start is near: no step is as long as that


class HelmertError(ValueError):
    """The points do not determine the transformation; names the freedom."""


@dataclass(frozen=True, slots=True, eq=False)
class MisclosureCovariance:
    """S = D + G G' of n points.

    Attributes:
        own_mm2: D, (n, 3, 3), positive definite.
        shared_mm: G, (n, 3, rank).
    """

    own_mm2: Floats
    shared_mm: Floats

    def solve(self, right: Floats) -> Floats:
        """S^-1 times columns, (n, 3, n_columns)."""
        without_shared = np.linalg.solve(self.own_mm2, right)
        if not self.shared_mm.size:
            return np.asarray(without_shared, dtype=np.float64)
        solved, inner = self._shared_parts()
        common = np.einsum("nir,nic->rc", solved, right)
        less = solved @ np.linalg.solve(inner, common)
        return np.asarray(without_shared - less, dtype=np.float64)

    @property
    def weights(self) -> Floats:
        """The blocks of the points in S^-1, (n, 3, 3)."""
        without_shared = np.linalg.inv(self.own_mm2)
        if not self.shared_mm.size:
            return np.asarray(without_shared, dtype=np.float64)
        solved, inner = self._shared_parts()
        less = solved @ np.linalg.inv(inner) @ solved.transpose(0, 2, 1)
        return np.asarray(without_shared - less, dtype=np.float64)

    def _shared_parts(self) -> tuple[Floats, Floats]:
        """D^-1 G, and I + G' D^-1 G."""
        solved = np.asarray(np.linalg.solve(self.own_mm2, self.shared_mm))
        inner = np.einsum("nir,nis->rs", self.shared_mm, solved)
        return solved, np.eye(len(inner)) + inner


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedHelmert:
    """A transformation with its covariance and residuals.

    Attributes:
        centre_mm: Reference point of xi, in the target system, (3,).
        cofactors: Of xi; with the stated covariances its covariance, (p, p).
        misclosures_mm: to - T(from), (n, 3).
        from_corrections_mm: v_from, (n, 3).
        to_corrections_mm: v_to, (n, 3).
        weighted_per_mm: S^-1 w, (n, 3).
        design: J, (n, 3, p).
    """

    transformation: Helmert
    centre_mm: Floats
    cofactors: Floats
    misclosures_mm: Floats
    from_corrections_mm: Floats
    to_corrections_mm: Floats
    misclosure_covariance: MisclosureCovariance
    weighted_per_mm: Floats
    design: Floats

    @property
    def sum_of_squares(self) -> float:
        """Compute w' S^-1 w."""
        return float(np.sum(self.weighted_per_mm * self.misclosures_mm))

    @property
    def redundancy(self) -> int:
        """Coordinates less parameters."""
        return self.misclosures_mm.size - len(self.cofactors)

    @property
    def sigma0(self) -> float | None:
        """Errors as found over errors as stated; None without redundancy."""
        if self.redundancy <= 0:
            return None
        return float(np.sqrt(self.sum_of_squares / self.redundancy))


def adjusted_helmert(
    from_mm: Floats,
    to_mm: Floats,
    from_covariance_mm2: Floats,
    to_covariance_mm2: Floats,
    *,
    from_shared_mm: Floats | None = None,
    to_shared_mm: Floats | None = None,
    with_scale: bool = False,
) -> AdjustedHelmert:
    """Adjust the transformation between two systems.

    Args:
        from_mm: Common points in the one, (n, 3).
        to_mm: In the other, (n, 3).
        from_covariance_mm2: (n, 3, 3). Of each point, one of both may be zero.
        to_covariance_mm2: (n, 3, 3).
        from_shared_mm: F, the part of the covariances that points share by the
            parameters of one arm, (n, 3, rank); None: nothing is shared.
        to_shared_mm: By the same parameters of the same arm, (n, 3, rank).
        with_scale: Seven parameters, else six.

    Raises:
        HelmertError: The points leave something open, named in the error.
        ValueError: A sum of both covariances is not positive definite.
    """
    for side in (to_mm, from_mm):
        problem = undetermined(shape_of(side))
        if problem is not None:
            raise HelmertError(problem)
    n_parameters = N_RIGID + int(with_scale)
    frozen = [
        covariances
        for covariances in (from_shared_mm, to_shared_mm)
        if covariances is not None
    ]
    none = np.zeros_like(frozen[0]) if frozen else np.zeros((*from_mm.shape, 0))
    from_shared = none if from_shared_mm is None else from_shared_mm
    to_shared = none if to_shared_mm is None else to_shared_mm
    from_own = from_covariance_mm2 - from_shared @ from_shared.transpose(0, 2, 1)
    to_own = to_covariance_mm2 - to_shared @ to_shared.transpose(0, 2, 1)
    traces = np.einsum("nii->n", from_covariance_mm2 + to_covariance_mm2)
    if not np.all(traces > 0.0):
        raise ValueError("a point has no errors on either side; state its covariance")
    weights = 1.0 / traces
    centre_mm = (weights / weights.sum()) @ to_mm
    extent_mm = float(np.sqrt(np.mean(np.sum((to_mm - centre_mm) ** 2, axis=1))))
    units = np.ones(n_parameters)
    units[3:] = 1.0 / extent_mm

    def linearised_at(transformation: Helmert) -> AdjustedHelmert:
        turn = transformation.scale * transformation.rotation
        covariance = MisclosureCovariance(
            to_own + turn @ from_own @ turn.T, to_shared - turn @ from_shared
        )
        misclosures_mm = to_mm - transformation.places_mm(from_mm)
        try:
            np.linalg.cholesky(covariance.own_mm2)
        except np.linalg.LinAlgError as error:
            raise ValueError(
                "the covariances of a point, both sides together, are not positive "
                "definite; state errors in all directions"
            ) from error
        weighted = covariance.solve(misclosures_mm[:, :, np.newaxis])[..., 0]
        common = np.einsum("nir,ni->r", covariance.shared_mm, weighted)
        from_corrections_mm: Floats = np.einsum("nij,nj->ni", from_own, weighted @ turn)
        from_corrections_mm -= from_shared @ common
        corrected_mm = transformation.places_mm(from_mm + from_corrections_mm)
        design = motions(corrected_mm - centre_mm, n_parameters)
        return AdjustedHelmert(
            transformation=transformation,
            centre_mm=centre_mm,
            cofactors=_cofactors(design, covariance, units),
            misclosures_mm=misclosures_mm,
            from_corrections_mm=from_corrections_mm,
            to_corrections_mm=-np.einsum("nij,nj->ni", to_own, weighted)
            - to_shared @ common,
            misclosure_covariance=covariance,
            weighted_per_mm=weighted,
            design=design,
        )

    start = closed_helmert(from_mm, to_mm, weights, with_scale=with_scale)
    adjusted, size = linearised_at(start), np.inf
    for _ in range(_MOST_STEPS):
        change = adjusted.cofactors @ np.einsum(
            "nip,ni->p", adjusted.design, adjusted.weighted_per_mm
        )
        before, size = size, float(np.max(np.abs(change / units))) / extent_mm
        if not size < _ASTRAY:
            break
        adjusted = linearised_at(_moved(adjusted.transformation, centre_mm, change))
        if size < _SMALL_STEP or (size < _SMALL_ENOUGH and size > 0.5 * before):
            break
    if not size < _SMALL_ENOUGH:
        raise HelmertError(_astray(shape_of(to_mm), size))
    return adjusted


def _astray(shape: Shape, size: float) -> str:
    text = (
        f"the adjustment does not converge (last step {size:.1g} of the extent of the "
        "points): their errors are as large as what they span, or names are exchanged"
    )
    if shape.straightness < _STRAIGHT:
        text += (
            "; they lie so near to one line that the rotation about it, about the "
            f"direction {direction_text(shape.axes[0])}, is undetermined"
        )
    return f"{text}; look at the names, and measure points farther apart"


def _cofactors(
    design: Floats, covariance: MisclosureCovariance, units: Floats
) -> Floats:
    """Compute (J' S^-1 J)^-1, in units in which its parts are alike."""
    design = design * units
    normal = np.einsum("nip,niq->pq", design, covariance.solve(design))
    try:
        inverse = np.linalg.inv(normal)
    except np.linalg.LinAlgError as error:
        raise HelmertError(
            "the points leave a direction open within rounding; measure points farther "
            "apart, not on one line"
        ) from error
    scaled = units[:, np.newaxis] * inverse * units
    cofactors: Floats = 0.5 * (scaled + scaled.T)
    return cofactors


def _moved(transformation: Helmert, centre_mm: Floats, change: Floats) -> Helmert:
    """Apply xi: y becomes c + shift + (1 + k) turn (y - c)."""
    turn = rotation_matrix(small_turn(change[3:6]))
    grown = 1.0 + (float(change[6]) if len(change) > N_RIGID else 0.0)
    shift_mm = centre_mm + change[:3] - grown * (turn @ centre_mm)
    return Helmert(turn, shift_mm, grown).after(transformation)


# Of the weight of a point: eigenvalues of B below are rounding.
_UNSEEN = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Reliability of n points.

    Attributes:
        shares: Redundancy numbers of the coordinates; all together the redundancy,
            (n, 3). Near 0: an error there distorts the transformation.
        seen_per_mm2: Eigenvalues of B, the least first, (n, 3); 0 where an error in
            that direction cannot be revealed by any test.
        directions: Of these, as rows, (n, 3, 3).
        moves: Q J' P, changes of xi by an error of a point, (n, p, 3).
    """

    shares: Floats
    seen_per_mm2: Floats
    directions: Floats
    moves: Floats


def reliability_of(adjusted: AdjustedHelmert) -> Reliability:
    weights = adjusted.misclosure_covariance.weights
    design, cofactors = adjusted.design, adjusted.cofactors
    weighted = adjusted.misclosure_covariance.solve(design)
    moves = cofactors @ np.swapaxes(weighted, 1, 2)
    hat = design @ moves
    shares = 1.0 - np.einsum("nii->ni", hat)
    visible = weights - weighted @ moves
    sizes, vectors = np.linalg.eigh(0.5 * (visible + np.swapaxes(visible, 1, 2)))
    least = _UNSEEN * np.einsum("nii->n", weights)[:, np.newaxis]
    return Reliability(
        shares=shares,
        seen_per_mm2=np.where(sizes > least, sizes, 0.0),
        directions=np.swapaxes(vectors, 1, 2),
        moves=moves,
    )


def point_statistics(adjusted: AdjustedHelmert, reliability: Reliability) -> Floats:
    """Compute the statistic of every point: chi-squared of its detectable part.

    Returns:
        (n,), with as many degrees of freedom as `seen_per_mm2` has values above 0.
    """
    parts = np.einsum("nki,ni->nk", reliability.directions, adjusted.weighted_per_mm)
    visible_per_mm2 = reliability.seen_per_mm2
    squares = np.divide(
        parts**2,
        visible_per_mm2,
        out=np.zeros_like(visible_per_mm2),
        where=visible_per_mm2 > 0.0,
    )
    total: Floats = squares.sum(axis=1)
    return total
