"""The linearised system: all equations whitened, each station's unknowns eliminated."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.lab.adjustment.problem import Network, State
from traverse.lab.adjustment.rank import Elimination, eliminate_unknowns, sequential_qr


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
        tuple(of_station[at] for of_station in kept) for at in range(3)
    )
    rms_mm = float(np.sqrt(squares_mm2 / max(n_mm, 1)))
    return System(
        tuple(eliminations), reduced, whiteners, all_offsets, following, total, rms_mm
    )


def sum_of_squares(network: Network, state: State, system: System) -> float:
    """Weigh the misclosures of a state with the weights of a system."""
    total = float(np.sum(network.parameters.expectations(state.arm)[:, -1] ** 2))
    for at, station in enumerate(network.stations):
        unknowns, corrections = state.unknowns[at], state.corrections[at]
        misclosures = network.all_misclosures(station, state.arm, unknowns, corrections)
        misclosures = misclosures - system.offsets[at]
        white = system.whiteners[at] @ misclosures[:, :, np.newaxis]
        certificates = network.certified(station, state.arm, unknowns)[:, -1]
        total += float(np.sum(white**2) + np.sum(certificates**2))
    return total
