"""The linearised system of a network: whitened, the stations' unknowns eliminated."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.lab.identification.equations.network import Network, State, Station
from traverse.lab.identification.equations.parameters import ArmValues
from traverse.lab.identification.equations.station_equations import (
    misclosures_mm,
    white_rows,
)
from traverse.lab.identification.solve.sequential_qr import (
    Elimination,
    eliminate_unknowns,
    sequential_qr,
)


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """The linearised, whitened, reduced system at some state.

    Attributes:
        eliminations: Of every station.
        upper: Of the arm's free parameters and the right side.
        whiteners: Of every station, (n_poses, n_rows, n_rows).
        offsets_mm: B v of every station, (n_poses, n_rows).
        corrections: v that follows, of every station, (n_poses, n_joints + 3).
        sum_of_squares: Weighted misclosures and certificates.
        rms_mm: Root mean square of the scalar misclosures as they are.
    """

    eliminations: tuple[Elimination, ...]
    upper: Floats
    whiteners: tuple[Floats, ...]
    offsets_mm: tuple[Floats, ...]
    corrections: tuple[Floats, ...]
    sum_of_squares: float
    rms_mm: float


def linearise(network: Network, state: State) -> System:
    """Set up, whiten and reduce all equations at a state."""
    n_free = network.parameters.n_free
    eliminations = []
    kept: tuple[list[Floats], list[Floats], list[Floats]] = ([], [], [])
    total, squares_mm2 = 0.0, 0.0
    for station, unknowns, corrections in zip(
        network.stations, state.unknowns, state.corrections, strict=True
    ):
        n_unknowns = len(station.scales)
        n_columns = n_unknowns + n_free + 1
        blocks = [certified(network, station, state.arm, unknowns)]
        seen: tuple[list[Floats], list[Floats], list[Floats]] = ([], [], [])
        upper = np.empty((0, n_columns))
        total += float(np.sum(blocks[0][:, -1] ** 2))
        for rows in white_rows(network, station, state.arm, unknowns, corrections):
            total += float(np.sum(rows.misclosures**2))
            squares_mm2 += float(np.sum(rows.misclosures_mm**2))
            seen[0].append(rows.whiteners)
            seen[1].append(rows.offsets_mm)
            seen[2].append(rows.corrections)
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
        for whole, parts in zip(kept, seen, strict=True):
            whole.append(np.concatenate(parts))
    reduced = sequential_qr([found.reduced for found in eliminations], n_free + 1)
    whiteners, offsets_mm, following = (tuple(whole) for whole in kept)
    rms_mm = float(np.sqrt(squares_mm2 / max(network.n_rows, 1)))
    return System(
        tuple(eliminations), reduced, whiteners, offsets_mm, following, total, rms_mm
    )


def sum_of_squares(network: Network, state: State, system: System) -> float:
    """Weigh the misclosures of a state with the weights of a system."""
    total = 0.0
    for at, (station, unknowns) in enumerate(
        zip(network.stations, state.unknowns, strict=True)
    ):
        corrections = state.corrections[at]
        found_mm = misclosures_mm(network, station, state.arm, unknowns, corrections)
        found_mm = found_mm - system.offsets_mm[at]
        white = system.whiteners[at] @ found_mm[:, :, np.newaxis]
        certificates = certified(network, station, state.arm, unknowns)[:, -1]
        total += float(np.sum(white**2) + np.sum(certificates**2))
    return total


def certified(
    network: Network, station: Station, arm: ArmValues, unknowns: Floats
) -> Floats:
    """Whiten a station's certificate: unknowns, parameters, right side.

    A standard whose certificate is off by some ppm is as long as it says and that
    much more.
    """
    certificate = station.artefact.certificate(unknowns, station.touches)
    misclosures_mm = certificate.misclosures_mm.copy()
    by_parameters = np.zeros((len(misclosures_mm), network.parameters.n_free))
    for length in station.artefact.lengths(unknowns):
        row = length.certificate_row
        if row is not None:
            certified_mm = length.value_mm - float(certificate.misclosures_mm[row])
            errors = network.parameters.length_errors(arm, station.artefact.id)
            misclosures_mm[row] -= 1e-6 * errors[0] * certified_mm
            by_parameters[row] -= 1e-6 * errors[1] * certified_mm
    inverse = 1.0 / certificate.std_mm[:, np.newaxis]
    return np.hstack(
        [
            certificate.by_unknowns * inverse,
            by_parameters * inverse,
            -misclosures_mm[:, np.newaxis] * inverse,
        ]
    )
