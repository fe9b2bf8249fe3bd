"""Least squares of shapes in 60 decimal digits, by another way than the code's.

Only Python's decimal arithmetic: distances as formulas, derivatives by differences,
which at this precision are exact to 30 digits, Newton's method on the sum of squares
with its full second derivatives, so a minimum is reached to 25 digits.
"""

from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext

import numpy as np

DIGITS = 80
STEP = Decimal(10) ** -24
Numbers = list[Decimal]
Distances = Callable[[Numbers, Numbers], Numbers]


def exact_minimum(
    squares_of: Distances, points: np.ndarray, start: Sequence[float]
) -> list[float]:
    """Parameters of the least sum of squares next to a start."""
    with localcontext() as context:
        context.prec = DIGITS
        exact_points = [[Decimal(float(x)) for x in point] for point in points]
        state = [Decimal(float(x)) for x in start]

        def total(values: Numbers) -> Decimal:
            return sum(
                (d * d for point in exact_points for d in squares_of(values, point)),
                Decimal(0),
            )

        for _ in range(6):
            gradient, second = _derivatives(total, state)
            step = _solved(second, [-g for g in gradient])
            state = [a + b for a, b in zip(state, step, strict=True)]
        assert max(abs(s) for s in step) < Decimal(10) ** -20
        return [float(value) for value in state]


def _derivatives(total, state):
    """Gradient and second derivatives by central differences."""
    n = len(state)

    def distances_at(*steps):
        moved = list(state)
        for index, sign in steps:
            moved[index] += sign * STEP
        return total(moved)

    middle = distances_at()
    plus = [distances_at((i, 1)) for i in range(n)]
    minus = [distances_at((i, -1)) for i in range(n)]
    gradient = [(p - m) / (2 * STEP) for p, m in zip(plus, minus, strict=True)]
    second = [[Decimal(0)] * n for _ in range(n)]
    for i in range(n):
        second[i][i] = (plus[i] - 2 * middle + minus[i]) / STEP**2
        for j in range(i):
            mixed = distances_at((i, 1), (j, 1)) - plus[i] - plus[j] + middle
            second[i][j] = second[j][i] = mixed / STEP**2
    return gradient, second


def _solved(matrix, right):
    """Gauss with the largest pivot."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    n = len(rows)
    for column in range(n):
        best = max(range(column, n), key=lambda r: abs(rows[r][column]))
        rows[column], rows[best] = rows[best], rows[column]
        for row in range(n):
            if row != column:
                factor = rows[row][column] / rows[column][column]
                rows[row] = [
                    a - factor * b for a, b in zip(rows[row], rows[column], strict=True)
                ]
    return [rows[r][n] / rows[r][r] for r in range(n)]


def sphere(values: Numbers, point: Numbers) -> Numbers:
    squares = sum((p - c) ** 2 for p, c in zip(point, values[:3], strict=True))
    return [squares.sqrt() - values[3]]


def plane(values: Numbers, point: Numbers) -> Numbers:
    """z = a x + b y + c, with orthogonal distances."""
    a, b, c = values
    return [(point[2] - a * point[0] - b * point[1] - c) / (1 + a * a + b * b).sqrt()]
