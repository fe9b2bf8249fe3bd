"""The linearised system: whitened equations, unknowns eliminated, split by rank.

Orthogonal elimination: tall systems to small triangles, a part at a time.

A triangle R represents all rows A so far: R^T R = A^T A. The station's own
unknowns are the first columns, so that the rows of R below them hold what the
station says about the arm alone.

The rank, decided on a noise scale.

Columns are scaled by the parameters' plausible deviations from the design, so that a
singular value s of the whitened triangle says: this combination is determined to 1/s of
what the design says already. Where s < 1 the campaign adds nothing: the combination
is held at its design value. Nothing is regularised; all others are ordinary
least squares.

What is undetermined by design (the scale, without any length) is left
out before anything is decided: away from the solution misclosures would feign
information about it, and the arm would shrink to nothing.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.lab.adjustment.problem import Network, State

# Rows gathered before each factorisation.
_STACKED_ROWS = 4096
# Numbers in a block that is factored at a time. Small enough for the cache, and for
# linear algebra libraries not to share it between threads, which costs more than it
# gains for matrices this narrow (six times more on two busy cores).
_BLOCK_SIZE = 7500


@dataclass(frozen=True, slots=True, eq=False)
class Elimination:
    """A station's unknowns as functions of the arm's parameters.

    With the step d of the parameters, the unknowns step by gain (right - left d).

    Attributes:
        gain: (n_unknowns, n_determined).
        left: (n_determined, n_free).
        right: (n_determined,).
        reduced: What is left for the arm, parameters and right side,
            (n_left, n_free + 1).
        held: Directions that the station's poses do not determine, in units of
            their scales, (n_held, n_unknowns).
    """

    gain: Floats
    left: Floats
    right: Floats
    reduced: Floats
    held: Floats

    def step(self, arm_step: Floats) -> Floats:
        """Compute the step of the unknowns, (n_unknowns,)."""
        return self.gain @ (self.right - self.left @ arm_step)


def sequential_qr(blocks: Iterable[Floats], n_columns: int) -> Floats:
    """Reduce rows to a triangle, (at most n_columns, n_columns)."""
    reduced = np.empty((0, n_columns))
    gathered: list[Floats] = []
    n_rows = 0
    for block in blocks:
        gathered.append(block)
        n_rows += len(block)
        if n_rows >= _STACKED_ROWS:
            reduced = _factor(np.vstack([reduced, *gathered]))
            gathered, n_rows = [], 0
    return _factor(np.vstack([reduced, *gathered]))


def eliminate_unknowns(upper: Floats, scales: Floats) -> Elimination:
    """Take a station's unknowns out of its triangle.

    Its columns are unknowns, parameters, right side. A direction that is known worse
    than the hopeless standard deviations is held, and its equation left to the arm.
    """
    n_unknowns = len(scales)
    of_unknowns, left_over = (
        upper[:n_unknowns, :n_unknowns] * scales,
        upper[:n_unknowns, n_unknowns:],
    )
    left, values, right = np.linalg.svd(of_unknowns)
    n_determined = int(np.count_nonzero(values > 1.0))
    turned = left.T @ left_over
    known = turned[:n_determined]
    gain = scales[:, np.newaxis] * right[:n_determined].T / values[:n_determined]
    return Elimination(
        gain=gain,
        left=known[:, :-1],
        right=known[:, -1],
        reduced=np.vstack([turned[n_determined:], upper[n_unknowns:, n_unknowns:]]),
        held=right[n_determined:],
    )


def _factor(rows: Floats) -> Floats:
    """Factor rows in blocks, then the blocks' triangles, until one is left."""
    n_columns = rows.shape[1]
    block_rows = max(_BLOCK_SIZE // n_columns, 2 * n_columns)
    while len(rows) > block_rows:
        n_blocks = -(-len(rows) // block_rows)
        padded = np.zeros((n_blocks * block_rows, n_columns))
        padded[: len(rows)] = rows
        blocks = padded.reshape(n_blocks, block_rows, n_columns)
        rows = np.asarray(np.linalg.qr(blocks, mode="r")).reshape(-1, n_columns)
    return np.asarray(np.linalg.qr(rows, mode="r"))


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
        return self.tolerances[:, np.newaxis] * kept

    @property
    def undetermined(self) -> Floats:
        """Directions in units of the tolerances, (n_undetermined, n_free)."""
        return self.directions[self.n_determined :]

    @property
    def design_deviations(self) -> Floats:
        """Plausible deviations of the undetermined directions, as columns.

        G with G G^T their covariance, where the design alone speaks of them,
        (n_free, n_undetermined).
        """
        deviations: Floats = self.tolerances[:, np.newaxis] * self.undetermined.T
        return deviations

    def step(self, to_design: Floats, damping: float = 0.0) -> tuple[Floats, Floats]:
        """Compute the step of the parameters, (n_free,), and its held part.

        That leads undetermined directions back to their design values, as
        `to_design` does all, (n_free,). Damping is added to the squares of singular
        values (Levenberg, Marquardt).
        """
        squares = self.values[: self.n_determined] ** 2
        kept = self.right[: self.n_determined] * (squares / (squares + damping))
        determined = self.inverse @ kept
        back = self.undetermined @ (to_design / self.tolerances) / (1.0 + damping)
        held = self.tolerances * (back @ self.undetermined)
        return determined + held, held


def decide_rank(
    upper: Floats,
    tolerances: Floats,
    known_null: Floats,
    n_determined: int | None = None,
) -> RankDecision:
    """Split the directions of a triangle.

    The triangle is of parameters and right side, (n_rows, n_free + 1). Some orthonormal
    directions are undetermined for certain, in units of the tolerances, (n_null,
    n_free). So many directions as are given count, or those above the threshold.
    """
    n_free = len(tolerances)
    rows = np.zeros((max(len(upper), n_free), n_free + 1))
    rows[: len(upper)] = upper
    remaining = np.linalg.svd(known_null)[2][len(known_null) :]
    left, values, within = np.linalg.svd(rows[:, :-1] * tolerances @ remaining.T)
    count = (
        int(np.count_nonzero(values > 1.0)) if n_determined is None else n_determined
    )
    n_null = len(known_null)
    return RankDecision(
        tolerances,
        np.concatenate([values, np.zeros(n_null)]),
        np.vstack([within @ remaining, known_null]),
        count,
        np.concatenate([(left.T @ rows[:, -1])[: len(values)], np.zeros(n_null)]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """The linearised, whitened, reduced system at some state.

    Attributes:
        upper: Of the arm's free parameters and the right side.
        whiteners: Of every station, (n_poses, most_rows, most_rows), zero in rows that
            a pose does not have.
        offsets: B v of every station, (n_poses, most_rows), likewise.
        corrections: v that follows, of every station, (n_poses, n_joints + 3 or 6).
        sum_of_squares: Weighted misclosures and certificates.
        rms_mm: Root mean square of the scalar misclosures as they are, without those of
            orientations.
    """

    eliminations: tuple[Elimination, ...]
    upper: Floats
    whiteners: tuple[Floats, ...]
    offsets: tuple[Floats, ...]
    corrections: tuple[Floats, ...]
    sum_of_squares: float
    rms_mm: float


def linearise(network: Network, state: State) -> System:
    """Set up, whiten and reduce all equations at a state."""
    n_free = network.parameters.n_free
    eliminations = []
    kept = []
    total, squares_mm2, n_mm = 0.0, 0.0, 0
    for station, unknowns, corrections in zip(
        network.stations, state.unknowns, state.corrections, strict=True
    ):
        n_unknowns = len(station.scales)
        n_columns = n_unknowns + n_free + 1
        blocks = [network.certified(station, state.arm, unknowns)]
        seen = []
        upper = np.empty((0, n_columns))
        total += float(np.sum(blocks[0][:, -1] ** 2))
        for rows in network.white_rows(station, state.arm, unknowns, corrections):
            total += float(np.sum(rows.misclosures**2))
            squares_mm2 += float(np.sum(rows.misclosures_mm**2))
            n_mm += rows.misclosures_mm.size
            whitener, offsets = rows.whiteners, rows.offsets
            if lacking := station.most_rows - rows.misclosures.shape[1]:
                whitener = np.pad(whitener, ((0, 0), (0, lacking), (0, lacking)))
                offsets = np.pad(offsets, ((0, 0), (0, lacking)))
            seen.append((whitener, offsets, rows.corrections))
            joined = np.concatenate(
                [
                    rows.by_unknowns,
                    rows.by_parameters,
                    -rows.misclosures[:, :, np.newaxis],
                ],
                axis=2,
            )
            blocks.append(joined.reshape(-1, n_columns))
            if len(blocks) >= 4:
                upper = sequential_qr([upper, *blocks], n_columns)
                blocks = []
        upper = sequential_qr([upper, *blocks], n_columns)
        eliminations.append(eliminate_unknowns(upper, station.scales))
        kept.append([np.concatenate(parts) for parts in zip(*seen, strict=True)])
    expected = network.parameters.expectations(state.arm)
    total += float(np.sum(expected[:, -1] ** 2))
    reduced = sequential_qr(
        [*(elimination.reduced for elimination in eliminations), expected], n_free + 1
    )
    whiteners, all_offsets, following = (
        tuple(of_station[index] for of_station in kept) for index in range(3)
    )
    rms_mm = float(np.sqrt(squares_mm2 / max(n_mm, 1)))
    return System(
        tuple(eliminations), reduced, whiteners, all_offsets, following, total, rms_mm
    )


def sum_of_squares(network: Network, state: State, system: System) -> float:
    """Weigh the misclosures of a state with the weights of a system."""
    total = float(np.sum(network.parameters.expectations(state.arm)[:, -1] ** 2))
    for index, station in enumerate(network.stations):
        unknowns, corrections = state.unknowns[index], state.corrections[index]
        misclosures = network.all_misclosures(station, state.arm, unknowns, corrections)
        misclosures = misclosures - system.offsets[index]
        white = system.whiteners[index] @ misclosures[:, :, np.newaxis]
        certificates = network.certified(station, state.arm, unknowns)[:, -1]
        total += float(np.sum(white**2) + np.sum(certificates**2))
    return total
