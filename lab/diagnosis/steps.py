"""Steps whose moments are not known: a slipped encoder, a knocked base.

A step at some gap between poses changes all later rows, so its column is a sum over
the later poses, and so is all that its test needs:

    c^T v,    Q^T c,    c^T c        with v the residuals and Q the unknowns' basis

One running sum from the last pose backwards gives these for every gap. With serial
correlation R of the rows' errors, c^T R^-1 takes the place of c^T, and c^T R^-1 c is a
running sum over pairs of poses.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import (  # type: ignore[import-untyped] # scipy ships no types
    solve_triangular,
)

from lab.diagnosis.candidate import Bank, BankName, Candidate
from lab.diagnosis.covariates import used_poses
from lab.diagnosis.entries import parameter_names
from lab.diagnosis.findings import LEAST_SINGULAR_VALUE, log_evidences
from lab.diagnosis.priors import STEP_MM, STEP_RAD, log_prior
from lab.diagnosis.rows import Rows

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Of the squared singular values: what differences of large sums leave of nothing.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class StepScan:
    """A step of one joint, or of the base, at every gap between poses.

    Attributes:
        joint: Its name; None: the base.
        at_s: Middles of the gaps, in the campaign's time, rising, (n_gaps,).
        singular_values: Of the projected columns in units of the plausible step, 0
            where a direction cannot be seen, (n_gaps, n_columns).
        along: z = U^T v of the fit's residuals, 0 likewise, (n_gaps, n_columns).
        evidences: Log Bayes factor of a step at each gap, (n_gaps,).
        sums: From whitened rows to the later rows' sums of each column; see `alongs`.
    """

    joint: str | None
    at_s: Floats
    singular_values: Floats
    along: Floats
    evidences: Floats
    sums: "_Sums"

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
        """A step at the best gap."""
        return step_candidate(self.joint, float(self.at_s[self.best]))

    def alongs(self, residuals: Floats) -> Floats:
        """Compute z of other residuals, projected like those of the fit.

        Args:
            residuals: (n_rows, n_draws).

        Returns:
            (n_gaps, n_columns, n_draws).
        """
        return self.sums.alongs(residuals)

    def largest(self, residuals: Floats) -> tuple[Floats, int]:
        """Find the largest T over all gaps of each of many residual vectors.

        Args:
            residuals: (n_rows, n_draws).

        Returns:
            (n_draws,), and the number of directions of a step.
        """
        statistics = np.sum(self.alongs(residuals) ** 2, axis=1)
        return np.asarray(statistics.max(axis=0)), self.singular_values.shape[1]


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """What turns residuals into z at every gap.

    Attributes:
        order: Rows with poses in the order of their times, (n_later,).
        starts: Where in `order` each pose begins, (n_poses,).
        gaps: Which poses have a gap before them, (n_gaps,).
        pieces: Columns of a step before all poses, by `order`, (n_later, n_columns).
        combinations: From sums of pieces to z, (n_gaps, n_columns, n_columns).
        root: Of the rows.
    """

    order: Integers
    starts: Integers
    gaps: Integers
    pieces: Floats
    combinations: Floats
    root: Floats | None

    def later(self, vectors: Floats) -> Floats:
        """c^T times vectors (n_rows, n), for every gap, (n_gaps, n_columns, n)."""
        vectors = _unwhitened(self.root, vectors)[self.order]
        summed = [
            np.add.reduceat(piece[:, np.newaxis] * vectors, self.starts, axis=0)
            for piece in self.pieces.T
        ]
        running = [np.cumsum(one[::-1], axis=0)[::-1][self.gaps] for one in summed]
        return np.stack(running, axis=1)

    def squares(self) -> Floats:
        """c^T c for every gap, (n_gaps, n_columns, n_columns)."""
        n_columns = self.pieces.shape[1]
        found = np.empty((len(self.gaps), n_columns, n_columns))
        inverse = _inverse(self.root)
        if inverse is not None:
            inverse = inverse[np.ix_(self.order, self.order)]
        for i in range(n_columns):
            for j in range(i + 1):
                a, b = self.pieces[:, i], self.pieces[:, j]
                if inverse is None:
                    steps = np.add.reduceat(a * b, self.starts)
                else:
                    pairs = a[:, np.newaxis] * inverse * b
                    pairs = np.add.reduceat(pairs, self.starts, axis=0)
                    pairs = np.add.reduceat(pairs, self.starts, axis=1)
                    both = np.triu(pairs) + np.triu(pairs.T, 1)
                    steps = both.sum(axis=1)
                running = np.cumsum(steps[::-1])[::-1][self.gaps]
                found[:, i, j] = found[:, j, i] = running
        return found

    def alongs(self, residuals: Floats) -> Floats:
        """Z of residuals (n_rows, n_draws), (n_gaps, n_columns, n_draws)."""
        found: Floats = self.combinations @ self.later(residuals)
        return found


def scan_slips(rows: Rows) -> tuple[StepScan, ...]:
    """Test a slip of every joint's encoder at every gap between poses.

    Args:
        rows: Of the fit.

    Returns:
        One scan a joint, with one column each; none where no two poses differ in time.
    """
    names = rows.adjustment.network.campaign.joint_names
    scans: list[StepScan] = []
    for joint, name in enumerate(names):
        pieces = STEP_RAD * rows.by_readings[:, joint : joint + 1]
        scans += _scans(rows, name, pieces)
    return tuple(scans)


def scan_base_steps(rows: Rows) -> tuple[StepScan, ...]:
    """Test a step of the base at every gap between poses.

    Args:
        rows: Of the fit.

    Returns:
        One scan, with three columns; none where no two poses differ in time.
    """
    return tuple(_scans(rows, None, STEP_MM * rows.by_centre))


def step_bank(rows: Rows, scans: tuple[StepScan, ...]) -> Bank:
    """Take the step at the best gap of each scan.

    Args:
        rows: Of the fit that the scans were made of.
        scans: Any of them.

    Returns:
        Whitened columns in units of plausible steps, (n_rows, n_columns).
    """
    parts = [np.empty((len(rows.poses), 0))]
    parts += [step_columns(rows, one.joint, float(one.at_s[one.best])) for one in scans]
    return Bank(tuple(scan.candidate for scan in scans), np.concatenate(parts, axis=1))


def step_candidate(joint: str | None, at_s: float) -> Candidate:
    """Describe a step.

    Args:
        joint: Whose encoder slipped; None: the base stepped.
        at_s: When, in the campaign's time.
    """
    kind = "base_step" if joint is None else "count_slip"
    parameters = parameter_names(kind)
    return Candidate(
        bank=BankName.LIBRARY,
        kind=kind,
        joint=joint,
        order=None,
        component=None,
        covariate=None,
        artefact=None,
        at_s=at_s,
        parameters=parameters,
        scales=(STEP_MM if joint is None else STEP_RAD,) * len(parameters),
        log_prior=log_prior(kind, joint, None),
        keys=(("at_s", at_s),),
    )


def step_columns(rows: Rows, joint: str | None, at_s: float) -> Floats:
    """Compute the columns of a step in units of the plausible one.

    Args:
        rows: Of the fit.
        joint: Whose encoder slipped; None: the base stepped.
        at_s: When, in the campaign's time.

    Returns:
        Whitened, (n_rows, n_columns).
    """
    pieces = STEP_MM * rows.by_centre
    if joint is not None:
        names = rows.adjustment.network.campaign.joint_names
        pieces = STEP_RAD * rows.by_readings[:, [names.index(joint)]]
    times_s = rows.block.row("campaign_s")[rows.poses]
    has_come = (rows.poses >= 0) & (times_s >= at_s)
    return rows.decorrelated(has_come[:, np.newaxis] * pieces)


def _scans(rows: Rows, joint: str | None, pieces: Floats) -> Iterator[StepScan]:
    times_s = rows.block.row("campaign_s")
    poses = used_poses(rows)
    poses = poses[np.argsort(times_s[poses], kind="stable")]
    gaps = 1 + np.flatnonzero(np.diff(times_s[poses]) > 0.0)
    if len(gaps) == 0:
        return
    ranks = np.full(len(times_s), -1)
    ranks[poses] = np.arange(len(poses))
    of_rows = np.where(rows.poses >= 0, ranks[rows.poses], -1)
    order = np.argsort(of_rows, kind="stable")[np.count_nonzero(of_rows < 0) :]
    starts = np.searchsorted(of_rows[order], np.arange(len(poses)))
    plain = _Sums(order, starts, gaps, pieces[order], np.empty(0), rows.root)
    squares = plain.squares()
    absorbed = plain.later(rows.basis)
    left = squares - absorbed @ absorbed.swapaxes(1, 2)
    values, vectors = np.linalg.eigh(left)
    # Judged by what was there before the unknowns absorbed their part.
    rounding = _ROUNDING * np.trace(squares, axis1=1, axis2=2)[:, np.newaxis]
    visible = values > np.maximum(LEAST_SINGULAR_VALUE**2, rounding)
    singular = np.sqrt(np.where(visible, values, 0.0))
    inverse = np.where(visible, 1.0 / np.where(visible, singular, 1.0), 0.0)
    turned = inverse[:, :, np.newaxis] * vectors.swapaxes(1, 2)
    sums = replace(plain, combinations=turned)
    along = sums.alongs(rows.residuals[:, np.newaxis])[:, :, 0]
    evidences = log_evidences(
        along**2, singular**2, rows.sum_of_squares, rows.redundancy
    )
    ordered_s = times_s[poses]
    at_s = 0.5 * (ordered_s[gaps - 1] + ordered_s[gaps])
    yield StepScan(joint, at_s, singular, along, evidences, sums)


def _unwhitened(root: Floats | None, vectors: Floats) -> Floats:
    """L^-T times vectors, so that products with plain columns are the whitened ones."""
    if root is None:
        return vectors
    found: Floats = solve_triangular(root, vectors, lower=True, trans="T")
    return found


def _inverse(root: Floats | None) -> Floats | None:
    """R^-1 of the correlation R = L L^T, (n_rows, n_rows)."""
    if root is None:
        return None
    whitener = solve_triangular(root, np.eye(len(root)), lower=True)
    inverse: Floats = whitener.T @ whitener
    return inverse
