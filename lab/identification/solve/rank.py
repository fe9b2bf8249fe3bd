"""The rank, decided on a noise scale.

Columns are scaled by the parameters' plausible deviations from the design, so that a
singular value s of the whitened triangle says: this combination is known to 1/s of
what the design says already. Where s < 1 the campaign adds nothing: the combination
is held at its design value. Nothing is regularised; all others are ordinary
least squares.

What is known beforehand to be undetermined (the scale, without any length) is left
out before anything is decided: away from the solution misclosures would feign
information about it, and the arm would shrink to nothing.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class RankDecision:
    """Directions that the data determine, and those that they do not.

    Attributes:
        tolerances: The units, (n_free,).
        values: Singular values of the scaled triangle, falling, (n_free,).
        directions: In units of the tolerances, a row each, (n_free, n_free).
        n_determined: How many of them count.
        right: Right side along the directions, (n_free,).
    """

    tolerances: Floats
    values: Floats
    directions: Floats
    n_determined: int
    right: Floats

    @property
    def inverse(self) -> Floats:
        """G with cofactors G G^T of the parameters, (n_free, n_determined)."""
        kept = self.directions[: self.n_determined].T / self.values[: self.n_determined]
        inverse: Floats = self.tolerances[:, np.newaxis] * kept
        return inverse

    @property
    def undetermined(self) -> Floats:
        """Directions in units of the tolerances, (n_undetermined, n_free)."""
        return self.directions[self.n_determined :]

    def step(self, to_design: Floats) -> tuple[Floats, Floats]:
        """Compute the step of the parameters.

        Args:
            to_design: The step that would lead back to the design, (n_free,).

        Returns:
            The step, (n_free,), and the part of it that leads undetermined directions
            back to their design values.
        """
        determined = self.inverse @ self.right[: self.n_determined]
        back = self.undetermined @ (to_design / self.tolerances)
        held = self.tolerances * (back @ self.undetermined)
        return determined + held, held


def split(
    upper: Floats,
    tolerances: Floats,
    known_null: Floats,
    n_determined: int | None = None,
) -> RankDecision:
    """Split the directions of a triangle.

    Args:
        upper: Parameters and right side, (n_rows, n_free + 1).
        tolerances: Plausible deviations from the design, (n_free,).
        known_null: Orthonormal directions in units of the tolerances that are
            undetermined for certain, (n_null, n_free).
        n_determined: How many directions count; None: those known better than that.
    """
    n_free = len(tolerances)
    rows = np.zeros((max(len(upper), n_free), n_free + 1))
    rows[: len(upper)] = upper
    others = np.linalg.svd(known_null)[2][len(known_null) :]
    left, values, within = np.linalg.svd(rows[:, :-1] * tolerances @ others.T)
    count = (
        int(np.count_nonzero(values > 1.0)) if n_determined is None else n_determined
    )
    n_null = len(known_null)
    return RankDecision(
        tolerances,
        np.concatenate([values, np.zeros(n_null)]),
        np.vstack([within @ others, known_null]),
        count,
        np.concatenate([(left.T @ rows[:, -1])[: len(values)], np.zeros(n_null)]),
    )
