"""Steps whose moments are not known: a slipped encoder, a knocked base.

They are tested at every gap between poses, and their evidence is the
mean over all gaps: a moment that had to be looked for counts for less.

A step at a gap changes all later rows, so its column c is a sum of pieces, one a later
pose, and one running sum from the last pose backwards gives c^T v for every gap. With
the serial correlation R = L L^T of the rows' errors the whitened column is L^-1 c: then
L^-T v takes the place of v, and c^T R^-1 c is a running sum over pairs of poses.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from traverse.arrays import Floats, Integers
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.mechanics.motions import BaseStep
from traverse.kinematics.effects.readings.rates import CountSlip
from traverse.lab.diagnosis.candidates.scoring import (
    LEAST_SINGULAR_VALUE,
    log_evidences,
)
from traverse.lab.diagnosis.model.candidate import Bank, candidate_of_kind
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import BankName, Candidate


@dataclass(frozen=True, slots=True, eq=False)
class StepSums:
    """The rows of a fit in the order of time, and the gaps between their poses.

    Attributes:
        order: Rows that belong to poses, those of the earliest pose first, (n_later,).
        starts: Where in `order` each pose begins, (n_used,).
        first_after: The first pose after each gap, (n_gaps,).
        at_s: Middles of the gaps in the campaign's time, rising, (n_gaps,).
        root: Lower Cholesky factor of the correlation of the rows' errors, or None.
        inverse: R^-1 of `order`, (n_later, n_later), or None.
    """

    order: Integers
    starts: Integers
    first_after: Integers
    at_s: Floats
    root: Floats | None
    inverse: Floats | None

    def products(self, pieces: Floats, vectors: Floats) -> Floats:
        """Compute c^T v, (n_gaps, n_columns, n_vectors).

        Of columns of a step before all poses, not whitened, (n_rows, n_columns), and
        whitened vectors, (n_rows, n_vectors).
        """
        if self.root is not None:
            vectors = linalg.solve_triangular(self.root, vectors, lower=True, trans="T")
        vectors, pieces = vectors[self.order], pieces[self.order]
        sums = np.empty((len(self.at_s), pieces.shape[1], vectors.shape[1]))
        for index, piece in enumerate(pieces.T):
            of_poses = np.add.reduceat(piece[:, np.newaxis] * vectors, self.starts)
            sums[:, index] = self._later(of_poses)
        return sums

    def squares(self, pieces: Floats) -> Floats:
        """Compute c^T c of such columns, (n_gaps, n_columns, n_columns)."""
        pieces = pieces[self.order]
        n_columns = pieces.shape[1]
        sums = np.empty((len(self.at_s), n_columns, n_columns))
        for i in range(n_columns):
            for j in range(i + 1):
                of_poses = self._of_poses(pieces[:, i], pieces[:, j])
                sums[:, i, j] = sums[:, j, i] = self._later(of_poses)
        return sums

    def _of_poses(self, a: Floats, b: Floats) -> Floats:
        """Contributions of poses to a^T b of itself and all later ones, (n_used,)."""
        if self.inverse is None:
            return np.asarray(np.add.reduceat(a * b, self.starts))
        pairs = np.add.reduceat(a[:, np.newaxis] * self.inverse, self.starts) * b
        pairs = np.add.reduceat(pairs, self.starts, axis=1)
        return np.asarray((np.triu(pairs) + np.triu(pairs.T, 1)).sum(axis=1))

    def _later(self, of_poses: Floats) -> Floats:
        """Add up what is after each gap, (n_used, ...) -> (n_gaps, ...)."""
        return np.asarray(np.cumsum(of_poses[::-1], axis=0)[::-1][self.first_after])


def step_sums_of(rows: ObservationEquations) -> StepSums:
    """Sort the rows of a fit by time; what belongs to no pose is left out.

    There is a gap between any two poses that take part and differ in time.
    """
    times_s = rows.block.row("campaign_s")
    poses = rows.used_poses
    poses = poses[np.argsort(times_s[poses], kind="stable")]
    ranks = np.zeros(len(times_s), dtype=np.int64)
    ranks[poses] = np.arange(len(poses))
    of_poses = np.flatnonzero(rows.poses >= 0)
    of_rows = ranks[rows.poses[of_poses]]
    by_time = np.argsort(of_rows, kind="stable")
    order = of_poses[by_time]
    ordered_s = times_s[poses]
    first_after = 1 + np.flatnonzero(np.diff(ordered_s) > 0.0)
    return StepSums(
        order=order,
        starts=np.searchsorted(of_rows[by_time], np.arange(len(poses))),
        first_after=first_after,
        at_s=0.5 * (ordered_s[first_after - 1] + ordered_s[first_after]),
        root=rows.root,
        inverse=_inverse(rows.root, order),
    )


def _inverse(root: Floats | None, order: Integers) -> Floats | None:
    if root is None:
        return None
    whitener = linalg.solve_triangular(root, np.eye(len(root))[:, order], lower=True)
    inverse: Floats = whitener.T @ whitener
    return inverse


_STEP_RAD = EFFECT_KINDS[CountSlip.kind].size
_STEP_MM = EFFECT_KINDS[BaseStep.kind].size
# Of the squared singular values: what differences of large sums leave of nothing.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class StepScan:
    """A step of one joint, or of the base, at every gap between poses.

    Attributes:
        joint: Its name; None: the base.
        gaps: Between the poses.
        pieces: Columns of a plausible step before all poses, (n_rows, n_columns).
        singular_values: Of the projected columns, 0 where a direction is undetectable,
            (n_gaps, n_columns).
        combinations: From c^T v to z = U^T v, (n_gaps, n_columns, n_columns).
        along: z of the fit's residuals, (n_gaps, n_columns).
        evidences: Log Bayes factor of a step at each gap, (n_gaps,).
    """

    joint: str | None
    gaps: StepSums
    pieces: Floats
    singular_values: Floats
    combinations: Floats
    along: Floats
    evidences: Floats

    @property
    def at_s(self) -> Floats:
        """Middles of the gaps, in the campaign's time, rising, (n_gaps,)."""
        return self.gaps.at_s

    @property
    def statistics(self) -> Floats:
        """T of a step at each gap, (n_gaps,)."""
        return np.asarray(np.sum(self.along**2, axis=1))

    @property
    def evidence(self) -> float:
        """Log Bayes factor of a step at an unknown gap: the mean over all of them."""
        return float(np.logaddexp.reduce(self.evidences) - np.log(len(self.at_s)))

    @property
    def best(self) -> int:
        """Which gap has the largest evidence."""
        return int(np.argmax(self.evidences))

    @property
    def candidate(self) -> Candidate:
        return step_candidate(self.joint, float(self.at_s[self.best]))

    def alongs(self, residuals: Floats) -> Floats:
        """Compute z of other residuals, (n_rows, n_draws), projected like the fit's.

        (n_gaps, n_columns, n_draws).
        """
        return self.combinations @ self.gaps.products(self.pieces, residuals)

    def largest(self, residuals: Floats) -> tuple[Floats, int]:
        """Find the largest T over all gaps, (n_draws,), and the directions of a step.

        Of each of many residual vectors, (n_rows, n_draws).
        """
        statistics = np.sum(self.alongs(residuals) ** 2, axis=1)
        return np.asarray(statistics.max(axis=0)), self.pieces.shape[1]


def scan_steps(rows: ObservationEquations) -> tuple[StepScan, ...]:
    """Test a slip of every encoder, and a step of the base, at every gap.

    One scan a joint, with one column each, and one of the base, with three; none where
    no two poses differ in time.
    """
    names = rows.adjustment.network.campaign.joint_names
    gaps = step_sums_of(rows)
    if len(gaps.at_s) == 0:
        return ()
    slips = np.split(_STEP_RAD * rows.by_readings, len(names), axis=1)
    return (
        *(
            _scan(rows, gaps, name, pieces)
            for name, pieces in zip(names, slips, strict=True)
        ),
        _scan(rows, gaps, None, _STEP_MM * rows.by_centre),
    )


def step_bank(rows: ObservationEquations, scans: tuple[StepScan, ...]) -> Bank:
    """Take the step at the best gap of each scan, as `step_columns`."""
    parts = [np.empty((len(rows.poses), 0))]
    parts += [
        step_columns(rows, best_step.joint, float(best_step.at_s[best_step.best]))
        for best_step in scans
    ]
    candidates = tuple(scan.candidate for scan in scans)
    return Bank(candidates, np.concatenate(parts, axis=1))


def step_candidate(joint: str | None, at_s: float) -> Candidate:
    """Describe a step.

    Of the encoder of a joint, or, without a joint, of the base; in the time of the
    campaign.
    """
    kind = BaseStep.kind if joint is None else CountSlip.kind
    size = EFFECT_KINDS[kind].size
    return candidate_of_kind(BankName.STEPS, kind, joint, {"at_s": at_s}, size)


def step_columns(rows: ObservationEquations, joint: str | None, at_s: float) -> Floats:
    """Compute the columns of a step in units of the plausible one, (n_rows, n_columns).

    Of the encoder of a joint, or, without a joint, of the base; whitened.
    """
    pieces = _STEP_MM * rows.by_centre
    if joint is not None:
        names = rows.adjustment.network.campaign.joint_names
        pieces = _STEP_RAD * rows.by_readings[:, [names.index(joint)]]
    times_s = rows.block.row("campaign_s")[rows.poses]
    has_occurred = (rows.poses >= 0) & (times_s >= at_s)
    return rows.decorrelated(has_occurred[:, np.newaxis] * pieces)


def _scan(
    rows: ObservationEquations, gaps: StepSums, joint: str | None, pieces: Floats
) -> StepScan:
    squares = gaps.squares(pieces)
    absorbed = gaps.products(pieces, rows.basis)
    values, vectors = np.linalg.eigh(squares - absorbed @ absorbed.swapaxes(1, 2))
    # Rounding is judged by what was there before the unknowns absorbed their part.
    rounding = _ROUNDING * np.trace(squares, axis1=1, axis2=2)[:, np.newaxis]
    visible = values > np.maximum(LEAST_SINGULAR_VALUE**2, rounding)
    singular = np.sqrt(np.where(visible, values, 0.0))
    inverse = np.where(visible, 1.0 / np.where(visible, singular, 1.0), 0.0)
    combinations = inverse[:, :, np.newaxis] * vectors.swapaxes(1, 2)
    residuals = rows.residuals[:, np.newaxis]
    along = (combinations @ gaps.products(pieces, residuals))[:, :, 0]
    evidences = log_evidences(
        along**2,
        (rows.coarseness * singular) ** 2,
        rows.sum_of_squares,
        rows.redundancy,
    )
    return StepScan(joint, gaps, pieces, singular, combinations, along, evidences)
