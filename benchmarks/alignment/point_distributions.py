"""Random common points, volumes and errors, and their alignment."""

from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.trials.lines import Line
from traverse.arrays import Floats
from traverse.kinematics.helmert.adjustment import HelmertError
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Box, disposition_index, volume_error
from traverse.kinematics.model.quaternion import rotation_matrix
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.nominal import fixed_volume
from traverse.lab.alignment.touches import CommonPoints, Place

STD_MM = 0.03
N_DRAWS = 100
NARROWEST = 0.005  # of the length


@dataclass(frozen=True, slots=True, eq=False)
class Disposition:
    """Common points and their purpose.

    Attributes:
        to_mm: in the part's system, (n, 3).
        true: from the arm's system to the part's.
    """

    to_mm: Floats
    volume: Box
    true: Helmert
    with_scale: bool


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Result for one distribution of points.

    Attributes:
        predicted_mm: root mean square error in the volume as predicted.
        residual_mm: root mean square length of the residuals.
        true_mm: root mean square error in the volume over many drawn measurements with
            equal errors, fitted by singular values.
        fit_mm: root mean square residual of one of these.
    """

    refused: str
    flags: tuple[str, ...]
    predicted_mm: float
    observed_mm: float
    residual_mm: float
    index: float
    true_mm: float
    fit_mm: float


def drawn_disposition(rng: np.random.Generator) -> Disposition:
    """Draw 3 to 12 points of any form, beside or around a volume."""
    n = int(rng.integers(3, 13))
    length_mm = float(np.exp(rng.uniform(np.log(100.0), np.log(2000.0))))
    narrow = np.exp(rng.uniform(np.log(NARROWEST), 0.0, 2))
    sides_mm = length_mm * np.array([1.0, narrow.max(), narrow.min()])
    turn = drawn_rotation(rng)
    to_mm = rng.uniform(-0.5, 0.5, (n, 3)) * sides_mm @ turn.T
    middle_mm = rng.normal(0.0, 0.4 * length_mm, 3)
    half_mm = 0.5 * length_mm * np.exp(rng.uniform(np.log(0.2), np.log(1.5), 3))
    true = Helmert(drawn_rotation(rng), rng.uniform(-1000.0, 1000.0, 3))
    volume = Box(middle_mm - half_mm, middle_mm + half_mm)
    return Disposition(to_mm, volume, true, bool(rng.integers(2)))


def drawn_rotation(rng: np.random.Generator) -> Floats:
    quaternion = rng.normal(size=4)
    return rotation_matrix(quaternion / np.linalg.norm(quaternion))


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One measurement of a disposition.

    Attributes:
        common: Its points, with errors of both sides.
        rng: Draws further measurements of it.
    """

    disposition: Disposition
    common: CommonPoints
    rng: np.random.Generator


def drawn_measurement(seed: int) -> Case:
    """Draw a disposition and errors of both sides, of every size and direction."""
    rng = np.random.default_rng([20, seed])
    drawn = drawn_disposition(rng)
    n = len(drawn.to_mm)
    roots = rng.normal(size=(2, n, 3, 3)) * STD_MM / np.sqrt(6.0)
    covariances = roots @ np.swapaxes(roots, 2, 3) + (0.1 * STD_MM) ** 2 * np.eye(3)
    errors = np.einsum(
        "snij,snj->sni",
        np.linalg.cholesky(covariances),
        rng.normal(size=(2, n, 3)),
    )
    from_mm = drawn.true.inverse().places_mm(drawn.to_mm) + errors[0]
    to_mm = drawn.to_mm + errors[1]
    common = CommonPoints(
        tuple(f"P{row}" for row in range(n)),
        tuple(Place(*pair) for pair in zip(from_mm, covariances[0], strict=True)),
        tuple(Place(*pair) for pair in zip(to_mm, covariances[1], strict=True)),
    )
    return Case(drawn, common, rng)


def run(case: Case) -> Line:
    return {"outcome": asdict(_outcome(case))}


def _outcome(case: Case) -> Outcome:
    drawn = case.disposition
    index = disposition_index(drawn.to_mm, drawn.volume, with_scale=drawn.with_scale)
    true_mm, fit_mm = error_of_many(drawn, case.rng)
    try:
        aligned = best_fit_alignment(
            case.common,
            fixed_volume(drawn.volume),
            "drawn",
            with_scale=drawn.with_scale,
        )
    except HelmertError as error:
        nothing = (float("nan"),) * 3
        return Outcome(str(error), (), *nothing, index.rms_mm, true_mm, fit_mm)
    # The prediction is compared before any test influences it.
    test, covariance = aligned.test, aligned.covariance
    if test is None or covariance is None:
        raise AssertionError("three points on no line always have redundancy")
    predicted = volume_error(aligned.volume, aligned.centre_mm, covariance)
    factor = 1.0 if test.passed else test.sigma0
    residuals = np.array([point.residual_mm for point in aligned.points])
    return Outcome(
        refused="",
        flags=tuple(flag.code for flag in aligned.flags),
        predicted_mm=predicted.rms_mm / factor,
        observed_mm=error_in_volume(aligned.transformation, drawn),
        residual_mm=float(np.sqrt(np.mean(np.sum(residuals**2, axis=1)))),
        index=index.rms_mm,
        true_mm=true_mm,
        fit_mm=fit_mm,
    )


def gauss_places_mm(volume: Box) -> Floats:
    """List eight places whose mean is that over the box, for squares of affine maps."""
    places: Floats = volume.mean_mm + (volume.corners_mm - volume.mean_mm) / np.sqrt(
        3.0
    )
    return places


def error_in_volume(alignment: Helmert, drawn: Disposition) -> float:
    """Compute the root mean square error of position of an alignment."""
    places_mm = gauss_places_mm(drawn.volume)
    there_mm = alignment.places_mm(drawn.true.inverse().places_mm(places_mm))
    return float(np.sqrt(np.mean(np.sum((there_mm - places_mm) ** 2, axis=1))))


def error_of_many(drawn: Disposition, rng: np.random.Generator) -> tuple[float, float]:
    """Measure a disposition many times, with equal errors, fitted by Kabsch's formula.

    Returns:
        Root mean square error in the volume, and root mean square residual of the
        first measurement.
    """
    n = len(drawn.to_mm)
    centre_mm = drawn.to_mm.mean(axis=0)
    y = drawn.to_mm - centre_mm
    noise = rng.normal(0.0, STD_MM, (N_DRAWS, n, 3))
    measured = y + noise
    means = measured.mean(axis=1)
    x = measured - means[:, np.newaxis]
    left, sizes, right = np.linalg.svd(np.swapaxes(x, 1, 2) @ y)
    signs = np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= signs[:, np.newaxis]
    turn = left @ right  # rows x turned: x @ turn
    scale = np.ones(N_DRAWS)
    if drawn.with_scale:
        sizes[:, 2] *= signs
        scale = sizes.sum(axis=1) / np.sum(x**2, axis=(1, 2))
    away = gauss_places_mm(drawn.volume) - centre_mm
    aligned = scale[:, np.newaxis, np.newaxis] * ((away - means[:, np.newaxis]) @ turn)
    error_mm = float(np.sqrt(np.mean(np.sum((aligned - away) ** 2, axis=2))))
    left_over = scale[0] * x[0] @ turn[0] - y
    return error_mm, float(np.sqrt(np.mean(np.sum(left_over**2, axis=1))))
