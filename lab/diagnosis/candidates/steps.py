"""Steps whose moments are not known: a slipped encoder, a knocked base.

They are tested at every gap between poses (`later_sums`), and their evidence is the
mean over all gaps: a moment that had to be looked for counts for less.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.mechanics.base_step import BaseStep
from traverse.kinematics.effects.readings.count_slip import CountSlip
from traverse.lab.diagnosis.candidates.effect_factory import parameter_names
from traverse.lab.diagnosis.candidates.priors import STEP_MM, STEP_RAD
from traverse.lab.diagnosis.candidates.scoring import (
    LEAST_SINGULAR_VALUE,
    log_evidences,
)
from traverse.lab.diagnosis.candidates.step_scan_sums import StepSums, step_sums_of
from traverse.lab.diagnosis.model.candidate import Bank, BankName, Candidate
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

# Of the squared singular values: what differences of large sums leave of nothing.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class StepScan:
    """A step of one joint, or of the base, at every gap between poses.

    Attributes:
        joint: Its name; None: the base.
        gaps: Between the poses.
        pieces: Columns of a plausible step before all poses, (n_rows, n_columns).
        singular_values: Of the projected columns, 0 where a direction cannot be seen,
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
        """A step at the best gap."""
        return step_candidate(self.joint, float(self.at_s[self.best]))

    def alongs(self, residuals: Floats) -> Floats:
        """Compute z of other residuals, projected like those of the fit.

        Args:
            residuals: (n_rows, n_draws).

        Returns:
            (n_gaps, n_columns, n_draws).
        """
        found: Floats = self.combinations @ self.gaps.products(self.pieces, residuals)
        return found

    def largest(self, residuals: Floats) -> tuple[Floats, int]:
        """Find the largest T over all gaps of each of many residual vectors.

        Args:
            residuals: (n_rows, n_draws).

        Returns:
            (n_draws,), and the number of directions of a step.
        """
        statistics = np.sum(self.alongs(residuals) ** 2, axis=1)
        return np.asarray(statistics.max(axis=0)), self.pieces.shape[1]


def scan_steps(rows: ObservationEquations) -> tuple[StepScan, ...]:
    """Test a slip of every encoder, and a step of the base, at every gap.

    Args:
        rows: Of the fit.

    Returns:
        One scan a joint, with one column each, and one of the base, with three; none
        where no two poses differ in time.
    """
    names = rows.adjustment.network.campaign.joint_names
    gaps = step_sums_of(rows)
    if len(gaps.at_s) == 0:
        return ()
    slips = np.split(STEP_RAD * rows.by_readings, len(names), axis=1)
    return (
        *(
            _scan(rows, gaps, name, pieces)
            for name, pieces in zip(names, slips, strict=True)
        ),
        _scan(rows, gaps, None, STEP_MM * rows.by_centre),
    )


def scan_slips(rows: ObservationEquations) -> tuple[StepScan, ...]:
    """Test a slip of every joint's encoder at every gap; see `scan_steps`."""
    return tuple(scan for scan in scan_steps(rows) if scan.joint is not None)


def scan_base_steps(rows: ObservationEquations) -> tuple[StepScan, ...]:
    """Test a step of the base at every gap; see `scan_steps`."""
    return tuple(scan for scan in scan_steps(rows) if scan.joint is None)


def step_bank(rows: ObservationEquations, scans: tuple[StepScan, ...]) -> Bank:
    """Take the step at the best gap of each scan.

    Args:
        rows: Of the fit that the scans were made of.
        scans: Any of them.

    Returns:
        Whitened columns in units of plausible steps, (n_rows, n_columns).
    """
    parts = [np.empty((len(rows.poses), 0))]
    parts += [step_columns(rows, one.joint, float(one.at_s[one.best])) for one in scans]
    candidates = tuple(scan.candidate for scan in scans)
    return Bank(candidates, np.concatenate(parts, axis=1))


def step_candidate(joint: str | None, at_s: float) -> Candidate:
    """Describe a step.

    Args:
        joint: Whose encoder slipped; None: the base stepped.
        at_s: When, in the campaign's time.
    """
    kind = BaseStep.kind if joint is None else CountSlip.kind
    parameters = parameter_names(kind)
    return Candidate(
        bank=BankName.STEPS,
        kind=kind,
        joint=joint,
        order=None,
        component=None,
        covariate=None,
        artefact=None,
        at_s=at_s,
        parameters=parameters,
        scales=(STEP_MM if joint is None else STEP_RAD,) * len(parameters),
        log_prior=EFFECT_KINDS[kind].preference(joint, None),
        keys=(("at_s", at_s),),
    )


def step_columns(rows: ObservationEquations, joint: str | None, at_s: float) -> Floats:
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
        along**2, singular**2, rows.sum_of_squares, rows.redundancy
    )
    return StepScan(joint, gaps, pieces, singular, combinations, along, evidences)
