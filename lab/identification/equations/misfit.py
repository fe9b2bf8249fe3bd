"""How far an adjustment is from its conditions, in millimetres."""

import numpy as np

from traverse.lab.identification.equations.network import Network, State
from traverse.lab.identification.equations.station_equations import misclosures_mm


def rms_mm(network: Network, state: State) -> float:
    """Compute the root mean square of all scalar misclosures of a state."""
    total, n_rows = 0.0, 0
    for station, unknowns in zip(network.stations, state.unknowns, strict=True):
        found_mm = misclosures_mm(network, station, state.arm, unknowns)
        total += float(np.sum(found_mm**2))
        n_rows += found_mm.size
    return float(np.sqrt(total / max(n_rows, 1)))
