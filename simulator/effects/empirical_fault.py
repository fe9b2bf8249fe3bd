"""A reading error that is a curve over some covariate."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import JointState, ReadingFault

OF_JOINT = ("_temperature_c", "_speed_rad_s", "_approach", "_rad")
OF_ARM = ("time_s", "temperature_c", "force_n")


@dataclass(frozen=True, slots=True)
class CurvedError(ReadingFault):
    """A natural cubic spline, level beyond its outer knots.

    Attributes:
        joints: Whose reading is spoilt.
        column: Of a campaign, without the name of the joint.
        of_joint: The joint of the covariate; -1 for one of the whole arm.
        knots: (m,) increasing.
        values_rad: (m,) there.
        slopes: (m,) there.
    """

    joints: slice
    column: str
    of_joint: int
    knots: Floats
    values_rad: Floats
    slopes: Floats

    def errors_rad(self, seen: JointState) -> Floats:
        """Cubic Hermite pieces."""
        at = np.clip(self._covariate(seen), self.knots[0], self.knots[-1])
        left = np.searchsorted(self.knots, at, side="right") - 1
        left = np.clip(left, 0, len(self.knots) - 2)
        width = np.diff(self.knots)[left]
        u = (at - self.knots[left]) / width
        rise = self.values_rad[left + 1] - self.values_rad[left]
        first, last = self.slopes[left] * width, self.slopes[left + 1] * width
        curve = self.values_rad[left] + u * (
            first
            + u * (3.0 * rise - 2.0 * first - last + u * (first + last - 2 * rise))
        )
        return curve[:, None]

    def _covariate(self, seen: JointState) -> Floats:
        around, k = seen.around, self.of_joint
        columns: dict[str, Floats] = {
            "_rad": seen.readings_rad[:, k],
            "_speed_rad_s": around.speed_rad_s[:, k],
            "_approach": around.approach[:, k],
            "time_s": around.time_s,
            "force_n": around.force_n,
        }
        return columns.get(self.column, around.temperature_c)


def natural_slopes(knots: Floats, values: Floats) -> Floats:
    """Slopes (m,) of the natural cubic spline: no bending at both ends.

    Second derivatives continuous: s_(i-1)/h_(i-1) + 2 s_i (1/h_(i-1) + 1/h_i) +
    s_(i+1)/h_i = 3 (c_(i-1)/h_(i-1) + c_i/h_i), c the slopes of the chords; at the
    ends 2 s_0 + s_1 = 3 c_0.
    """
    weights = 1.0 / np.diff(knots)
    pulls = 3.0 * weights**2 * np.diff(values)
    system, right = np.zeros((len(knots), len(knots))), np.zeros(len(knots))
    for i, weight in enumerate(weights.tolist()):
        system[i : i + 2, i : i + 2] += weight * np.array([[2.0, 1.0], [1.0, 2.0]])
    right[:-1] += pulls
    right[1:] += pulls
    return np.asarray(np.linalg.solve(system, right), dtype=np.float64)
