"""Joint trajectory: pieces of polynomials of the fifth degree."""

from dataclasses import dataclass, field

import numpy as np

from traverse.arrays import Floats, Indices

STANDING_RAD_S = 1e-9  # slower is no motion
NEARLY_OVER = 1.0 - 1e-3  # of a piece, where those that end at rest still move


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Turns as a function of time; before and after it the arm rests.

    Attributes:
        breaks_s: (n_pieces + 1,) ends of the pieces, from 0 on.
        coefficients: (n_pieces, 6, n_joints) of u^0 to u^5, u from 0 to 1 in a piece.
    """

    breaks_s: Floats
    coefficients: Floats
    _senses: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_senses", self._left_senses())

    @property
    def duration_s(self) -> float:
        return float(self.breaks_s[-1])

    def turns(self, times_s: Floats) -> Floats:
        """Return turns from the base posture (n, n_joints) at times (n,)."""
        piece, u, _ = self._places(times_s)
        terms = self.coefficients[piece]
        turns = terms[:, 5]
        for power in (4, 3, 2, 1, 0):
            turns = turns * u + terms[:, power]
        return turns

    def speeds(self, times_s: Floats) -> Floats:
        """Return speeds of the turns (n, n_joints) [rad/s] at times (n,)."""
        piece, u, lengths_s = self._places(times_s)
        speeds: Floats = self._rates(piece, u) / lengths_s
        return speeds

    def senses(self, times_s: Floats) -> Floats:
        """Return signs of the last motion, (n, n_joints): -1, +1, or 0 before any."""
        piece, u, lengths_s = self._places(times_s)
        speeds = self._rates(piece, u) / lengths_s
        moving = np.abs(speeds) > STANDING_RAD_S
        # A pause late in a piece counts as rest in it.
        left = self._senses[piece + (u[:, 0] > 0.5)]
        return np.where(moving, np.sign(speeds), left)

    @property
    def last_senses(self) -> Floats:
        """Signs of the joints' last motion, (n_joints,)."""
        last: Floats = self._senses[-1]
        return last

    def _left_senses(self) -> Floats:
        """Return signs of the last motion before each piece, and at the end."""
        n_pieces, _, n_joints = self.coefficients.shape
        u = np.full((n_pieces, 1), NEARLY_OVER)
        rates = self._rates(np.arange(n_pieces), u) / np.diff(self.breaks_s)[:, None]
        senses = np.zeros((n_pieces + 1, n_joints))
        for piece, rate in enumerate(rates):
            moving = np.abs(rate) > STANDING_RAD_S
            senses[piece + 1] = np.where(moving, np.sign(rate), senses[piece])
        return senses

    def _rates(self, piece: Indices, u: Floats) -> Floats:
        """Return derivatives by u, (n, n_joints)."""
        terms = self.coefficients[piece]
        rates = 5.0 * terms[:, 5]
        for power in (4, 3, 2, 1):
            rates = rates * u + power * terms[:, power]
        return rates

    def _places(self, times_s: Floats) -> tuple[Indices, Floats, Floats]:
        """Return pieces (n,), positions in them (n, 1) and their durations (n, 1)."""
        clipped_s = np.clip(times_s, 0.0, self.breaks_s[-1])
        piece = np.searchsorted(self.breaks_s, clipped_s, side="right") - 1
        piece = np.clip(piece, 0, len(self.coefficients) - 1)
        start = self.breaks_s[piece]
        lengths_s = self.breaks_s[piece + 1] - start
        return piece, ((clipped_s - start) / lengths_s)[:, None], lengths_s[:, None]


def rest_pieces(posture_rad: Floats) -> Floats:
    """Return a piece (1, 6, n_joints) at rest."""
    pieces = np.zeros((1, 6, len(posture_rad)))
    pieces[0, 0] = posture_rad
    return pieces


def move_pieces(start_rad: Floats, end_rad: Floats) -> Floats:
    """One piece of least jerk between two postures (n_joints,), at rest at both."""
    pieces = np.zeros((1, 6, len(start_rad)))
    change = end_rad - start_rad
    pieces[0, 0] = start_rad
    pieces[0, 3], pieces[0, 4], pieces[0, 5] = 10 * change, -15 * change, 6 * change
    return pieces


def spline_pieces(times_s: Floats, postures_rad: Floats) -> Floats:
    """Pass through postures at given times, at rest at both ends.

    A cubic spline: the unknown velocities m at the knots make accelerations continuous,
    m_(i-1)/h_(i-1) + 2 m_i (1/h_(i-1) + 1/h_i) + m_(i+1)/h_i = 3 (s_(i-1)/h_(i-1) +
    s_i/h_i), with s the slopes of the chords.

    Args:
        times_s: (n,), n >= 2, increasing.
        postures_rad: (n, n_joints)

    Returns:
        (n - 1, 6, n_joints)
    """
    steps_s = np.diff(times_s)[:, None]
    slopes = np.diff(postures_rad, axis=0) / steps_s
    velocities = np.zeros_like(postures_rad)
    diagonal = 2.0 * (1.0 / steps_s[:-1] + 1.0 / steps_s[1:])
    right = 3.0 * (slopes[:-1] / steps_s[:-1] + slopes[1:] / steps_s[1:])
    for i in range(1, len(right)):
        factor = 1.0 / steps_s[i] / diagonal[i - 1]
        diagonal[i] -= factor / steps_s[i]
        right[i] -= factor * right[i - 1]
    for i in range(len(right) - 1, -1, -1):
        right[i] -= velocities[i + 2] / steps_s[i + 1]
        velocities[i + 1] = right[i] / diagonal[i]
    pieces = np.zeros((len(steps_s), 6, postures_rad.shape[1]))
    first, last = velocities[:-1] * steps_s, velocities[1:] * steps_s
    change = np.diff(postures_rad, axis=0)
    pieces[:, 0], pieces[:, 1] = postures_rad[:-1], first
    pieces[:, 2] = 3.0 * change - 2.0 * first - last
    pieces[:, 3] = first + last - 2.0 * change
    return pieces
