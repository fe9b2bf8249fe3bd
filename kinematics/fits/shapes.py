"""Planes and spheres through points, by least squares, and how well they are known.

A plane through the mean m is exact by singular values; distances are (p - m) . n. Those
of a sphere are |p - c| - r, made least by Gauss-Newton steps: |p - c|^2 = r^2 is linear
in c and r^2 - |c|^2, and that algebraic solution starts them.

All is without unit: points are taken about their mean, over their extent. Of points
that scatter alike in all directions with the standard deviation s, the parameters have
the covariance s^2 Q; the cofactors Q = (A' A)^-1 are those of the last step. To first
order in s.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import across
from traverse.plurals import counted

_MOST_STEPS = 200
# Steps, in extents of the points: below the first, sums of squares are equal but for
# rounding and no longer compared; the second is of rounding itself; above the third it
# was no convergence.
_NEAR = 1e-5
_SMALL_STEP = 1e-14
_SMALL_ENOUGH = 1e-8
_LEAST_FRACTION = 1e-6
_SINGULAR = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Precision:
    """Uncertainty of a fitted shape.

    Attributes:
        cofactors: Q in the order of parameters of the shape, singular where
            they hang together (a direction has two freedoms, not three).
        redundancy: Number of distances less number of freedoms.
    """

    cofactors: Floats
    redundancy: int
    sum_of_squares_mm2: float

    @property
    def std_mm(self) -> float | None:
        """Standard deviation of a distance as estimated; None without redundancy."""
        if self.redundancy <= 0:
            return None
        return float(np.sqrt(self.sum_of_squares_mm2 / self.redundancy))

    def covariance(self, std_mm: float | None = None) -> Floats:
        """Compute the covariance of the parameters.

        Args:
            std_mm: Of a point in each direction; None: as estimated from the fit.

        Raises:
            ValueError: Nothing is left over to estimate it from.
        """
        std_mm = self.std_mm if std_mm is None else std_mm
        if std_mm is None:
            raise ValueError(
                "the fit has no redundancy to estimate the scatter of points from; "
                "give std_mm, or measure more points"
            )
        scaled: Floats = std_mm**2 * self.cofactors
        return scaled


State = TypeVar("State")
Linearised = Callable[[State], tuple[Floats, Floats]]
Moved = Callable[[State, Floats], State]


def adjusted(
    state: State, linearised: Linearised[State], moved: Moved[State], shape: str
) -> tuple[State, Floats, Floats]:
    """Minimise the sum of squares.

    Args:
        state: start.
        linearised: returns distances, (n,), and their derivatives, (n, n_steps).
        moved: applies a step, (n_steps,).
        shape: name in errors.

    Returns:
        The solution, and `linearised` there.

    Raises:
        ValueError: points do not determine the shape, or there is no convergence.
    """
    distances, design = linearised(state)
    size = np.inf
    for _ in range(_MOST_STEPS):
        step = (-np.linalg.lstsq(design, distances, rcond=None)[0]).astype(np.float64)
        before, size = size, float(np.max(np.abs(step)))
        squares, fraction = float(distances @ distances), 1.0
        while True:
            part: Floats = np.multiply(fraction, step)
            trial = moved(state, part)
            trial_distances, its_design = linearised(trial)
            if size < _NEAR or float(trial_distances @ trial_distances) <= squares:
                break
            if fraction < _LEAST_FRACTION:
                raise ValueError(_astray(shape, size))
            fraction *= 0.5
        state, distances, design = trial, trial_distances, its_design
        if size < _SMALL_STEP or (size < _SMALL_ENOUGH and size > 0.5 * before):
            break
    if not size < _SMALL_ENOUGH:
        raise ValueError(_astray(shape, size))
    return state, distances, design


def _astray(shape: str, size: float) -> str:
    return (
        f"the fit of a {shape} does not converge (last step {size:.1g} of the extent "
        f"of the points); they do not look like a {shape}, or cover too little of it"
    )


def inverse_normal(design: Floats, shape: str) -> Floats:
    """Compute (A' A)^-1, (n_steps, n_steps).

    Raises:
        ValueError: Some parameter is not determined.
    """
    _, sizes, rows = np.linalg.svd(design, full_matrices=False)
    if not sizes[-1] > _SINGULAR * sizes[0]:
        raise ValueError(
            f"the points do not determine a {shape}; measure points elsewhere on it too"
        )
    scaled = rows.T / sizes
    inverse: Floats = (scaled @ scaled.T).astype(np.float64)
    return inverse


# Least ratio of singular values of centred points: below, rounding decides the fit.
FLAT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points in units of their own extent, about their mean.

    Attributes:
        points: (n_points, 3), without unit.
        mean_mm: (3,).
        axes: principal directions as rows, the longest first, (3, 3).
        sizes: singular values along them, of the first 1 at most, (3,).
    """

    points: Floats
    mean_mm: Floats
    extent_mm: float
    axes: Floats
    sizes: Floats

    def refuse_degenerate(self, shape: str, *, flat: bool) -> None:
        """Refuse points in one plane, or on one line.

        Raises:
            ValueError: They are, and fit no single shape.
        """
        if not self.sizes[2 if flat else 1] > FLAT * self.sizes[0]:
            where = "in one plane" if flat else "on one line"
            remedy = "at other heights" if flat else "beside it"
            raise ValueError(
                f"all {len(self.points)} points lie {where}, which fits no single "
                f"{shape}; measure points {remedy} too"
            )

    def quality(
        self, shape: str, distances: Floats, design: Floats, known: Floats
    ) -> tuple[float, Precision]:
        """Return the root mean square for each point, and the precision.

        Args:
            shape: name in errors.
            distances: in the unit of the points, (n_distances,).
            design: their derivatives, (n_distances, n_freedoms).
            known: changes of the shape's parameters with its freedoms.
        """
        squares_mm2 = self.extent_mm**2 * float(distances @ distances)
        cofactors = known @ inverse_normal(design, shape) @ known.T
        redundancy = design.shape[0] - design.shape[1]
        precision = Precision(cofactors, redundancy, squares_mm2)
        return float(np.sqrt(squares_mm2 / len(self.points))), precision


def turned_positive(direction: Floats) -> Floats:
    """Reverse a direction (3,) whose largest component is negative."""
    turned: Floats = direction * np.sign(direction[np.argmax(np.abs(direction))])
    return turned


def checked_points(points_mm: Floats, at_least: int) -> Floats:
    """Return points (n_points, 3) as floats.

    Raises:
        ValueError: Another shape, values that are not finite, too few points.
    """
    points_mm = np.asarray(points_mm, dtype=np.float64)
    if points_mm.ndim != 2 or points_mm.shape[1] != 3:
        raise ValueError(f"points have shape {points_mm.shape}, expected (n_points, 3)")
    if not np.all(np.isfinite(points_mm)):
        raise ValueError("points hold values that are not finite; leave those out")
    if len(points_mm) < at_least:
        raise ValueError(
            f"{counted(len(points_mm), 'point')} given, expected at least {at_least}; "
            "measure more"
        )
    return points_mm


def cloud_of(points_mm: Floats, at_least: int) -> Cloud:
    """Check points (n_points, 3) and bring them into their own size.

    Raises:
        ValueError: As `checked_points` says; or one and the same place again and again.
    """
    points_mm = checked_points(points_mm, at_least)
    mean_mm = points_mm.mean(axis=0)
    local_mm = points_mm - mean_mm
    _, sizes_mm, axes = np.linalg.svd(local_mm, full_matrices=len(points_mm) < 3)
    sizes_mm = np.append(sizes_mm, np.zeros(3 - len(sizes_mm)))
    extent_mm = float(sizes_mm[0])
    if not extent_mm > FLAT * FLAT * (1.0 + float(np.max(np.abs(mean_mm)))):
        if at_least > 3:  # a plane is what the fits of spheres speak of
            raise ValueError(
                f"all {len(points_mm)} points lie in one plane, even in one place; "
                "measure points elsewhere too"
            )
        raise ValueError(
            f"all {len(points_mm)} points lie in one place; measure points elsewhere "
            "too"
        )
    return Cloud(local_mm / extent_mm, mean_mm, extent_mm, axes, sizes_mm / extent_mm)


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A fitted plane.

    Attributes:
        point_mm: The mean of the points, (3,).
        normal: Unit vector, its largest component positive, (3,).
        rms_mm: Root mean square of the distances.
        precision: Of the point (mm), which moves along the normal only, and of the
            normal: (6, 6).
    """

    point_mm: Floats
    normal: Floats
    rms_mm: float
    precision: Precision


def fit_plane(points_mm: Floats) -> Plane:
    """Fit a plane to at least three points, (n_points, 3).

    Raises:
        ValueError: Too few points, on one line, or spread alike in all directions.
    """
    cloud = cloud_of(points_mm, at_least=3)
    cloud.refuse_degenerate("plane", flat=False)
    if not cloud.sizes[2] < (1.0 - FLAT) * cloud.sizes[1]:
        raise ValueError(
            f"the {len(cloud.points)} points are as thick as they are wide, which fits "
            "no single plane; leave out those that are not on it"
        )
    normal = turned_positive(cloud.axes[2])
    first, second = across(normal)
    points = cloud.points
    design = np.column_stack([-np.ones(len(points)), points @ first, points @ second])
    known = np.zeros((6, 3))
    known[:3, 0] = normal
    known[3:, 1], known[3:, 2] = first / cloud.extent_mm, second / cloud.extent_mm
    quality = cloud.quality("plane", points @ normal, design, known)
    return Plane(cloud.mean_mm, normal, *quality)


_State = tuple[Floats, float]


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """A fitted sphere; rms is of the geometric distances to it.

    Attributes:
        centre_mm: (3,).
        rms_mm: Root mean square of |p - c| - r over all points.
        precision: Of centre and radius, or of the centre alone.
    """

    centre_mm: Floats
    radius_mm: float
    rms_mm: float
    precision: Precision


def fit_sphere(points_mm: Floats) -> Sphere:
    """Fit centre and radius to points of a surface.

    Args:
        points_mm: At least four, not in one plane, (n_points, 3).

    Raises:
        ValueError: Too few points, or all in one plane.
    """
    return _fit(points_mm, None)


def fit_sphere_of_radius(points_mm: Floats, radius_mm: float) -> Sphere:
    """Fit the centre of a sphere whose radius is known.

    Args:
        points_mm: At least four, not in one plane, (n_points, 3).
        radius_mm: Of the surface that the points lie on, above zero.

    Raises:
        ValueError: Too few points, all in one plane, or no radius.
    """
    if not (np.isfinite(radius_mm) and radius_mm > 0.0):
        raise ValueError(f"radius_mm is {radius_mm}, expected a length above zero")
    fitted = _fit(points_mm, radius_mm)
    return Sphere(fitted.centre_mm, radius_mm, fitted.rms_mm, fitted.precision)


def _fit(points_mm: Floats, radius_mm: float | None) -> Sphere:
    cloud = cloud_of(points_mm, at_least=4)
    cloud.refuse_degenerate("sphere", flat=True)
    points = cloud.points

    def linearised(state: _State) -> tuple[Floats, Floats]:
        centre, radius = state
        from_centre = points - centre
        lengths = np.linalg.norm(from_centre, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies in the centre of the sphere; leave it out")
        design = -(from_centre / lengths[:, np.newaxis])
        if radius_mm is None:
            design = np.column_stack([design, -np.ones(len(points))])
        return lengths - radius, design

    def moved(state: _State, step: Floats) -> _State:
        return state[0] + step[:3], state[1] + float(step[3:].sum())

    centre, radius = _algebraic(points)
    if radius_mm is not None:
        radius = radius_mm / cloud.extent_mm
    state, distances, design = adjusted((centre, radius), linearised, moved, "sphere")
    return Sphere(
        cloud.mean_mm + cloud.extent_mm * state[0],
        cloud.extent_mm * state[1],
        *cloud.quality("sphere", distances, design, np.eye(design.shape[1])),
    )


def _algebraic(local: Floats) -> _State:
    design = np.column_stack([2.0 * local, np.ones(len(local))])
    squares = np.einsum("ij,ij->i", local, local)
    solution = np.linalg.lstsq(design, squares, rcond=None)[0]
    centre: Floats = solution[:3]
    return centre, float(np.sqrt(solution[3] + centre @ centre))
