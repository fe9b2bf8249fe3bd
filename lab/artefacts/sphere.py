"""A sphere: centre unknown, radius known or not (the paper's case d).

w = |x - c| - R (1 + growth) - r outside, + r inside

Starting values and distances serve ball bars too.
"""

import functools
from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats, Integers
from traverse.lab.artefacts.artefact import (
    PLACE_SCALE_MM,
    Artefact,
    Certificate,
    Equations,
    ExpandingArtefact,
    Length,
    Touches,
    certificate_of,
)

_STEPS = 20
# Where most centres are farther off than this part of the extent after so many steps,
# they lie on no sphere: with wrong signs or zeros of joints, which are tried by dozens.
_HOPELESS, _STEPS_OF_HOPE = 0.2, 4
# Steps end below this part of the extent: a starting value needs no more.
_SETTLED = 1e-9
_FAR = 0.5  # of the radius: such a centre is on no such sphere
_FEW, _TRIES, _SEED = 4, 40, 1
# Below this part of its largest, a singular value of the cloud is flatness.
FLAT = 1e-6


def offset_sign(side: str) -> float:
    """Return the sign with which the probe's radius enters a sphere's."""
    return 1.0 if side == "outside" else -1.0


def distances(centres_mm: Floats, sphere_mm: Floats) -> tuple[Floats, Floats]:
    """Compute distances (n,) and unit vectors (n, 3) from one or n sphere centres."""
    away_mm = centres_mm - sphere_mm
    distances_mm: Floats = np.linalg.norm(away_mm, axis=1)
    # In the very centre any direction is as good as another, but for none at all.
    is_centre = distances_mm < 1e-9
    units = away_mm / np.where(is_centre, 1.0, distances_mm)[:, np.newaxis]
    units[is_centre] = (0.0, 0.0, 1.0)
    return distances_mm, units


def start_centre(centres_mm: Floats, radius_mm: float | None) -> tuple[Floats, float]:
    """Fit a sphere through ball centres: algebraically, then a few robust steps.

    |x - c|^2 = rho^2 is linear in c and rho^2 - |c|^2. Steps are weighted by the
    first powers of the residuals, so that a few blunders do not matter. Where some are
    far off all the same, four centres at a time are tried: the fit with the smallest
    median residual is taken (Rousseeuw 1984).

    Args:
        centres_mm: (n_poses, 3), at least one.
        radius_mm: Of the sphere on which the centres lie, or None to estimate it.

    Returns:
        The sphere's centre, (3,), and the radius for ball centres.
    """
    mean_mm = centres_mm.mean(axis=0)
    local_mm = centres_mm - mean_mm
    extent_mm = max(float(np.linalg.norm(local_mm, axis=1).max()), 1.0)
    local = local_mm / extent_mm
    known = None if radius_mm is None else radius_mm / extent_mm
    is_known = known is not None
    (centre,), (radius,) = _direct(local[np.newaxis], known)
    centre, radius = polished(local, centre, float(radius), is_known=is_known)
    if np.max(_off(local, centre, radius)) > _FAR * radius and len(local) > _FEW:
        centres, radii = _direct(local[_fours(len(local))], known)
        centres, radii = np.vstack([centre, centres]), np.append(radius, radii)
        best = np.argmin(np.median(_off(local, centres, radii), axis=-1))
        start = centres[best], float(radii[best])
        centre, radius = polished(local, *start, is_known=is_known)
    return mean_mm + centre * extent_mm, radius * extent_mm


@functools.lru_cache(maxsize=64)
def _fours(n: int) -> Integers:
    """Draw the rows of four centres out of n, (tries, 4): the same ones each time."""
    rng = np.random.default_rng(_SEED)
    return np.array([rng.choice(n, _FEW, replace=False) for _ in range(_TRIES)])


def _direct(clouds: Floats, known: float | None) -> tuple[Floats, Floats]:
    """Fit one sphere to each cloud, algebraically, and at a known radius if any.

    Args:
        clouds: Of ball centres, (n_clouds, n_centres, 3).
        known: Radius.

    Returns:
        Centres (n_clouds, 3) and radii (n_clouds,).
    """
    centres, radii = _algebraic(clouds)
    if known is None:
        return centres, radii
    return _at_known_radius(clouds, centres, known), np.full(len(clouds), known)


def polished(
    local: Floats,
    centre: Floats,
    radius: float,
    *,
    is_known: bool,
    lengths: Floats | float = 0.0,
) -> tuple[Floats, float]:
    """Improve a centre, and its radius unless that is known, by a few robust steps.

    Args:
        local: Ball centres, (n_poses, 3).
        centre: To begin with, (3,).
        radius: To begin with.
        is_known: Whether the radius stays.
        lengths: Beyond which the radius counts, (n_poses,).
    """
    hopeless = _HOPELESS * float(np.abs(local).max())
    for index in range(_STEPS):
        away, units = distances(local, centre)
        residuals = away - lengths - radius
        scale = max(float(np.median(np.abs(residuals))), 1e-9)
        if index == _STEPS_OF_HOPE and scale > hopeless:
            break
        weights = 1.0 / np.sqrt(1.0 + (residuals / (3.0 * scale)) ** 2)
        columns = [-units] if is_known else [-units, -np.ones((len(local), 1))]
        design = weights[:, np.newaxis] * np.hstack(columns)
        step = np.linalg.lstsq(design, -weights * residuals, rcond=FLAT)[0]
        centre = centre + step[:3]
        radius += float(step[3:].sum())
        if np.max(np.abs(step)) < _SETTLED:
            break
    return centre, radius


def _off(local: Floats, centre: Floats, radius: Floats | float) -> Floats:
    """Compute distances from spheres: (..., n_centres) of centres (..., 3)."""
    away = np.linalg.norm(local - centre[..., np.newaxis, :], axis=-1)
    off: Floats = np.abs(away - np.asarray(radius)[..., np.newaxis])
    return off


def _algebraic(clouds: Floats) -> tuple[Floats, Floats]:
    design = np.concatenate([2.0 * clouds, np.ones((*clouds.shape[:-1], 1))], axis=-1)
    squares = np.einsum("...ij,...ij->...i", clouds, clouds)
    # Least squares of all clouds at once; a flat one has its shortest solution.
    solutions = np.einsum(
        "...ij,...j->...i", np.linalg.pinv(design, rcond=FLAT), squares
    )
    centres = solutions[..., :3]
    radii_2 = solutions[..., 3] + np.einsum("...i,...i->...", centres, centres)
    return centres, np.sqrt(np.maximum(radii_2, 1e-12))


def _at_known_radius(clouds: Floats, centres: Floats, radius: float) -> Floats:
    """Choose the side of nearly flat patches on which their centres may lie.

    Along the normal of a patch the algebraic centre is weak: it is replaced by
    the one at the known radius from the middle, on the same side.
    """
    normals = np.linalg.eigh(np.swapaxes(clouds, -1, -2) @ clouds)[1][..., 0]
    heights = np.einsum("...i,...i->...", centres, normals)
    across = centres - heights[..., np.newaxis] * normals
    squares = np.einsum("...i,...i->...", across, across)
    sagittas = np.copysign(np.sqrt(np.maximum(radius**2 - squares, 0.0)), heights)
    chosen = across + sagittas[..., np.newaxis] * normals
    before, after = _off(clouds, centres, radius), _off(clouds, chosen, radius)
    is_nearer = np.median(after, axis=-1) < np.median(before, axis=-1)
    return np.where(is_nearer[..., np.newaxis], chosen, centres)


# Of the radius: how far touches are from a mirror image that may be the ball itself,
# and how far that must be away to be another.
_NEARLY = 0.25
_ANOTHER = 0.1


def mirrored_centre(
    centres_mm: Floats, centre_mm: Floats, radius_mm: float
) -> Floats | None:
    """Find the centre on the other side of a patch of touches, (3,).

    Three touches lie on two spheres of one radius, and a few more nearly so: as long as
    the arm is millimetres off, either may be the ball. None: the touches, (n, 3),
    exclude the other one, or are too few to tell where it would be.
    """
    if len(centres_mm) < _FEW - 1:
        return None
    mean_mm = centres_mm.mean(axis=0)
    local_mm = centres_mm - mean_mm
    normal = np.linalg.eigh(local_mm.T @ local_mm)[1][:, 0]
    from_mean_mm = centre_mm - mean_mm
    mirrored_mm = from_mean_mm - 2.0 * (from_mean_mm @ normal) * normal
    mirrored_mm, _ = polished(local_mm, mirrored_mm, radius_mm, is_known=True)
    off_mm = _off(local_mm, mirrored_mm, radius_mm)
    apart_mm = float(np.linalg.norm(mirrored_mm - from_mean_mm))
    is_near = float(np.sqrt(np.mean(off_mm**2))) < _NEARLY * radius_mm
    if not is_near or apart_mm < _ANOTHER * radius_mm:
        return None
    found_mm: Floats = mean_mm + mirrored_mm
    return found_mm


class Sphere(ExpandingArtefact):
    """A ball or a bowl; state: centre and radius."""

    kind: Literal["sphere"]
    radius_mm: float | None = Field(default=None, gt=0.0)
    radius_std_mm: float | None = Field(default=None, gt=0.0)
    side: Literal["outside", "inside"] = "outside"

    def fixes_scale(self, touches: Touches) -> bool:
        return bool(self.certified_lengths)

    @property
    def certified_lengths(self) -> dict[str, float]:
        return {} if self.radius_mm is None else {"radius_mm": self.radius_mm}

    def without_certificate(self, name: str) -> Artefact:
        return self.model_copy(update={"radius_mm": None})

    def with_contact_shift(self, shift_mm: float) -> Artefact:
        if self.radius_mm is None:
            return self
        radius_mm = self.radius_mm + offset_sign(self.side) * shift_mm
        return self.model_copy(update={"radius_mm": radius_mm})

    def unknown_scales(self, touches: Touches) -> Floats:
        return np.array([PLACE_SCALE_MM] * 4)

    def start(self, centres_mm: Floats, touches: Touches) -> Floats:
        offset_mm = offset_sign(self.side) * touches.radius_mm
        known_mm = None if self.radius_mm is None else self.radius_mm + offset_mm
        centre_mm, radius_mm = start_centre(centres_mm, known_mm)
        return np.append(centre_mm, radius_mm - offset_mm)

    def mirror_images(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> tuple[Floats, ...]:
        if self.radius_mm is None:
            return ()
        around_mm = state[3] + offset_sign(self.side) * touches.radius_mm
        other_mm = mirrored_centre(centres_mm, state[:3], float(around_mm))
        return () if other_mm is None else (np.append(other_mm, state[3]),)

    def equations(
        self, state: Floats, centres_mm: Floats, touches: Touches
    ) -> Equations:
        """Set up w = |x - c| - R (1 + growth) -+ r."""
        distances_mm, units = distances(centres_mm, state[:3])
        growths = 1.0 + touches.growths
        offset_mm = offset_sign(self.side) * touches.radius_mm
        misclosures_mm = distances_mm - state[3] * growths - offset_mm
        by_unknowns = np.column_stack([-units, -growths])
        return Equations.of_surface(misclosures_mm, units, by_unknowns)

    def certificate(self, state: Floats, touches: Touches) -> Certificate:
        if self.radius_mm is None:
            return super().certificate(state, touches)
        std_mm = self.radius_std_mm
        return certificate_of(self.lengths(state), [self.radius_mm], [std_mm])

    def place(self, state: Floats) -> dict[str, Any]:
        return {"centre_mm": state[:3].tolist()}

    def lengths(self, state: Floats) -> tuple[Length, ...]:
        row = None if self.radius_mm is None else 0
        by_unknowns = np.array([0.0, 0.0, 0.0, 1.0])
        return (Length("radius_mm", float(state[3]), by_unknowns, row),)
