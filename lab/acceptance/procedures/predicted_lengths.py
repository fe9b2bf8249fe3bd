"""Errors of length beside those that the arm's own files predict.

The uncertainty of a test value leaves the arm out: the arm is tested. An identified arm
states its own, by which its points and lengths are judged in use. Here that statement
is tested against standards. With the touches' errors (noise of each touch alone, and
what all share by the arm's parameters) a length moves by w' dx, w its derivatives, so
all errors of length together have the covariance

    V = diag(own) + F F' + u u' of each standard,

and e' V^-1 e is chi-squared where the arm file states what is there.
"""

from collections.abc import Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.uncertainty.joint_covariance import fit_weights
from traverse.lab.acceptance.conformity import (
    PREDICTED_FACTOR,
    LengthError,
    PredictedLengths,
)
from traverse.lab.acceptance.procedures.lengths import face_normal, joined, repeats_of
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.ball_bar import BallBar
from traverse.lab.artefacts.plane import ParallelPlanes
from traverse.lab.measured_points.measurement import (
    ArtefactTouches,
    Measurement,
    certified_length,
    fitted,
)
from traverse.lab.statistics.distributions import GLOBAL_LEVEL, chi_square_p_value


def predicted_lengths(
    measured: Measurement, errors: Sequence[LengthError]
) -> PredictedLengths | None:
    """Compare errors of length with what the arm's files predict.

    None where the touches' errors are not known.
    """
    if not errors or measured.errors_unknown is not None:
        return None
    repeats = {
        name: repeats_of(measured.artefacts[name], measured.of(name))
        for name in dict.fromkeys(error.artefact for error in errors)
    }
    own_mm2, shared_mm = np.empty(len(errors)), []
    for row, error in enumerate(errors):
        first, second = repeats[error.artefact][error.repeat - 1]
        touched = joined(first, second)
        if touched.errors is None:
            return None
        weights = _weights(measured.artefacts[error.artefact], first, second)
        covariance, shared = touched.errors.combined(weights[np.newaxis])
        own_mm2[row] = covariance[0, 0] - shared[0] @ shared[0]
        shared_mm.append(shared[0])
    factor = np.array(shared_mm)
    of_arm_mm2 = own_mm2 + np.sum(factor**2, axis=1)
    # What has the same certified length is the same standard, in other places.
    certified = [certified_length(measured.artefacts[e.artefact]) for e in errors]
    standards = list(dict.fromkeys(certified))
    standards_mm = np.zeros((len(errors), len(standards)))
    for row, length in enumerate(certified):
        standards_mm[row, standards.index(length)] = length[1]
    common = np.column_stack([factor, standards_mm])
    covariance = np.diag(own_mm2) + common @ common.T
    found_mm = np.array([error.error_mm for error in errors])
    squares = float(found_mm @ np.linalg.solve(covariance, found_mm))
    p_value = chi_square_p_value(squares, len(errors))
    expanded_mm = PREDICTED_FACTOR * np.sqrt(np.diag(covariance))
    return PredictedLengths(
        tuple(np.sqrt(of_arm_mm2).tolist()),
        int(np.count_nonzero(np.abs(found_mm) <= expanded_mm)),
        float(np.sqrt(squares / len(errors))),
        p_value,
        p_value >= GLOBAL_LEVEL,
    )


def _weights(
    artefact: Artefact, first: ArtefactTouches, second: ArtefactTouches
) -> Floats:
    """Return how a length moves with the places of its touches, (n, 3)."""
    if isinstance(artefact, ParallelPlanes):
        places_mm = np.concatenate([first.places_mm, second.places_mm])
        normal = face_normal(first, second)
        normal = normal * np.sign(normal @ (places_mm[-1] - places_mm[0]))
        across = np.linalg.svd(normal[np.newaxis])[2][1:]
        on_first = np.arange(len(places_mm)) < len(first)
        local_mm = places_mm - places_mm.mean(axis=0)
        design = np.column_stack([on_first, ~on_first, -local_mm @ across.T])
        heights = fit_weights(design, np.broadcast_to(normal, places_mm.shape))
        between: Floats = heights[1] - heights[0]
        return between
    ends = []
    for touched in (first, second):
        if isinstance(artefact, BallBar):
            # To first order the centre does not depend on the radius that is held.
            centre_mm = fitted(touched, artefact.id).centre_mm
            normals = touched.places_mm - centre_mm
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            ends.append((centre_mm, fit_weights(normals, normals)))
        else:
            ends.append((touched.places_mm[0], np.eye(3)[:, np.newaxis]))
    (start_mm, of_start), (end_mm, of_end) = ends
    way = (end_mm - start_mm) / np.linalg.norm(end_mm - start_mm)
    return np.concatenate(
        [-np.einsum("q,qni->ni", way, of_start), np.einsum("q,qni->ni", way, of_end)]
    )
