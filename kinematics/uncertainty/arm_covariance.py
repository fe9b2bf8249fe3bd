"""Covariance of an identified arm: its file, and the covariance of points.

`arm.cov.npz` holds names, values and the covariance C over the components of axes,
links, probe vector, effects and origin (docs/reference/identification.md). A ball's
centre x has from it the covariance A C A^T, A = dx/dp.
"""

import hashlib
import io
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.columns import columns
from traverse.kinematics.effects.pose import corrected_readings
from traverse.kinematics.model.derivatives import ProbeDerivatives, probe_derivatives
from traverse.kinematics.model.geometry import Geometry
from traverse.strict_toml.files import bytes_of

_LONGEST_NAME_BYTES = 4 * 256  # UTF-32, as NumPy stores text
_HEADER_BYTES = 4096  # of an array in the format of NumPy
_ROUNDING = 1e-9  # of the largest variance: below, a negative one is rounding


@dataclass(frozen=True, slots=True, eq=False)
class ArmCovariance:
    """The covariance of an arm's parameters as a factor.

    Attributes:
        factor: F with C = F F^T, (n_parameters, rank); parameters in the order of
            `parameter_names`.
    """

    factor: Floats

    @property
    def covariance(self) -> Floats:
        return self.factor @ self.factor.T


def parameter_names(
    joint_names: Sequence[str], effects: Sequence[str]
) -> tuple[str, ...]:
    """Name all parameters in the order of `parameter_columns`."""
    geometry = [
        f"{joint}.{part}.{component}"
        for part in ("axis", "link")
        for joint in joint_names
        for component in "xyz"
    ]
    probe = [f"probe.vector.{component}" for component in "xyz"]
    origin = [f"origin.{component}" for component in "xyz"]
    return (*geometry, *probe, *effects, *origin)


def parameter_columns(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> tuple[Floats, ProbeDerivatives]:
    """Differentiate the ball's centres by all parameters.

    Columns of the geometry are those of the arm at the corrected readings: deflections
    change them by a relative 1e-4 at most.

    Returns:
        dx/dp, (n_samples, 3, n_parameters), and the derivatives that it is made of.
    """
    known = probe_derivatives(geometry, corrected_readings(geometry, effects, block))
    n = len(block)
    by_effects = (
        columns(geometry, effects, block)
        if effects.corrections
        else np.empty((n, 3, 0))
    )
    parts = [
        known.by_axes.reshape(n, 3, -1),
        known.by_links.reshape(n, 3, -1),
        known.by_probe_vector,
        by_effects,
        known.by_origin,
    ]
    return np.concatenate(parts, axis=2), known


def read_arm_covariance(
    path: Path, names: Sequence[str], digest: str | None
) -> ArmCovariance:
    """Read `arm.cov.npz`.

    Args:
        path: Of the file.
        names: Of the arm's parameters, see `parameter_names`.
        digest: Of the file, as stated in the arm file; None without.

    Raises:
        ValueError: The file is missing, damaged, or of another arm; names the remedy.
    """
    try:
        data = bytes_of(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(
            f"{path}: {reason}; put the file that `traverse identify` wrote beside "
            "the arm file, or remove covariance_file from it"
        ) from error
    its_digest = hashlib.sha256(data).hexdigest()
    if digest is not None and digest.removeprefix("sha256:") != its_digest:
        raise ValueError(
            f"{path} is not the file that the arm file was written with: its digest "
            f"is {its_digest}, expected {digest}; copy both from the same "
            "identification"
        )
    try:
        _check_sizes(data, len(names))
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            stored_names = [str(name) for name in file["names"]]
            covariance = np.array(file["covariance"], dtype=np.float64)
    except (
        OSError,
        ValueError,
        KeyError,
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        MemoryError,
    ) as error:
        raise ValueError(
            f"{path} is no covariance of an arm ({error}); identify the arm again"
        ) from error
    return ArmCovariance(_factor(path, names, stored_names, covariance))


def read_parameter_covariance(
    path: Path, arm: Arm, effects: ArmEffects, inline_effects: ArmEffects
) -> ArmCovariance | None:
    """Read the covariance of the parameters that poses depend on.

    Args:
        path: of the arm file, which names the file of the covariance.
        arm: as read.
        effects: all in the arm file.
        inline_effects: of poses.

    Returns:
        The covariance; None if the arm file names none.

    Raises:
        ValueError: the file is missing, damaged, or of another arm.
    """
    reference = arm.identification
    if reference is None or reference.covariance_file is None:
        return None
    joints = [joint.name for joint in arm.joints]
    names = parameter_names(joints, effects.parameter_names)
    covariance = read_arm_covariance(
        path.parent / reference.covariance_file, names, reference.covariance_digest
    )
    places = {name: row for row, name in enumerate(names)}
    kept = parameter_names(joints, inline_effects.parameter_names)
    return ArmCovariance(covariance.factor[[places[name] for name in kept]])


def _check_sizes(data: bytes, n_parameters: int) -> None:
    """Check the sizes of arrays before they are unpacked.

    A few kilobytes of an archive can stand for gigabytes.

    Raises:
        ValueError: one is larger, or it is no archive.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for entry in archive.infolist():
            width_bytes = _LONGEST_NAME_BYTES if "names" in entry.filename else 8
            rows = n_parameters if "names" in entry.filename else n_parameters**2
            limit_bytes = rows * width_bytes + _HEADER_BYTES
            if entry.file_size > limit_bytes:
                raise ValueError(
                    f"{entry.filename} unpacks to {entry.file_size} bytes; an arm of "
                    f"{n_parameters} parameters needs at most {limit_bytes}"
                )


def _factor(
    path: Path, names: Sequence[str], stored_names: Sequence[str], covariance: Floats
) -> Floats:
    places = {name: number for number, name in enumerate(names)}
    unknown = [name for name in stored_names if name not in places]
    if unknown or len(set(stored_names)) != len(stored_names):
        wrong = ", ".join(unknown[:5]) or "a name that occurs twice"
        raise ValueError(
            f"{path} has parameters that this arm has not: {wrong}; use the file of "
            "the same identification as the arm file"
        )
    n = len(stored_names)
    if covariance.shape != (n, n) or not np.isfinite(covariance).all():
        raise ValueError(
            f"{path}: covariance has shape {covariance.shape} or is not finite, "
            f"expected finite ({n}, {n}); identify the arm again"
        )
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(scale > 0.0, scale, 1.0)
    correlations = covariance / safe[:, np.newaxis] / safe
    values, vectors = np.linalg.eigh(0.5 * (correlations + correlations.T))
    largest = max(float(np.max(values, initial=0.0)), 1.0)
    asymmetry = float(np.max(np.abs(correlations - correlations.T), initial=0.0))
    if float(np.min(values, initial=0.0)) < -_ROUNDING * largest or asymmetry > 1e-6:
        raise ValueError(
            f"{path}: what it holds is no covariance (smallest eigenvalue "
            f"{float(values.min()):g} of the correlations); identify the arm again"
        )
    rank = values > _ROUNDING * largest
    factor = np.zeros((len(names), int(rank.sum())))
    rows = [places[name] for name in stored_names]
    factor[rows] = safe[:, np.newaxis] * vectors[:, rank] * np.sqrt(values[rank])
    return factor
