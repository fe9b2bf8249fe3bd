"""The formulas of an arm in 50 decimal digits, as written in the paper.

Only Python's decimal arithmetic: every float is taken as the number that it is.
"""

from collections.abc import Sequence
from decimal import Decimal, localcontext

from traverse.kinematics.model.geometry import Geometry

DIGITS = 50
TWO_PI = 2 * Decimal("3.14159265358979323846264338327950288419716939937510582097494459")
Vector = list[Decimal]


def exact_pose(
    geometry: Geometry, angles_rad: Sequence[float]
) -> tuple[Vector, Vector]:
    """Centre and direction of one sample: x_0 + sum_k P_k r_k + P_n v, and P_n d."""
    with localcontext() as context:
        context.prec = DIGITS
        x = exactly(geometry.origin_mm)
        columns = [exactly(row) for row in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        for alpha, zero, axis, link in zip(
            angles_rad,
            geometry.zeros_rad,
            geometry.axes,
            geometry.links_mm,
            strict=True,
        ):
            theta = Decimal(float(alpha)) - Decimal(float(zero))
            turned = [turn(exactly(axis), theta, e) for e in exactly_unit()]
            columns = [image(columns, e) for e in turned]
            x = [a + b for a, b in zip(x, image(columns, exactly(link)), strict=True)]
        probe = image(columns, exactly(geometry.probe_vector_mm))
        centre = [a + b for a, b in zip(x, probe, strict=True)]
        return centre, image(columns, exactly(geometry.probe_direction))


def exactly(values: Sequence[float]) -> Vector:
    return [Decimal(float(value)) for value in values]


def exactly_unit() -> list[Vector]:
    return [exactly(row) for row in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]


def image(columns: list[Vector], vector: Vector) -> Vector:
    """The matrix of these columns times a vector."""
    return [
        sum(c[i] * v for c, v in zip(columns, vector, strict=True)) for i in range(3)
    ]


def turn(u: Vector, theta: Decimal, w: Vector) -> Vector:
    """Rodrigues' formula."""
    sine, cosine = sine_cosine(theta)
    along = sum(a * b for a, b in zip(u, w, strict=True))
    across = [u[i - 2] * w[i - 1] - u[i - 1] * w[i - 2] for i in range(3)]
    return [
        cosine * w[i] + sine * across[i] + (1 - cosine) * along * u[i] for i in range(3)
    ]


def sine_cosine(theta: Decimal) -> tuple[Decimal, Decimal]:
    """Taylor's series of the angle left after whole turns."""
    theta %= TWO_PI
    sums, term, n = [Decimal(0), Decimal(0)], Decimal(1), 0
    while abs(term) > Decimal(10) ** -DIGITS or n < 8:
        sums[n % 2] += -term if n % 4 > 1 else term
        n += 1
        term = term * theta / n
    return sums[1], sums[0]
