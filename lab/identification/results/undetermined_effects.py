"""Possible effect of undetermined directions at the probe, if the design is off."""

from collections.abc import Mapping

import numpy as np

from traverse.arrays import Floats
from traverse.lab.identification.equations.probe_effect import probe_effects_mm
from traverse.lab.identification.results.result import Identification


def undetermined_effects_mm(result: Identification) -> Floats:
    """Compute the probe's rms shift by one plausible deviation, (n_undetermined,).

    The motion of the arm as a whole is taken out.
    """
    if not result.undetermined:
        return np.empty(0)
    split = result.adjustment.split
    network = result.adjustment.network
    names = network.parameters.free_names
    named = np.array([_row(entry.direction, names) for entry in result.undetermined])
    # Small components were left out of the names; the subspace restores them.
    whole = named @ split.undetermined.T @ split.undetermined
    whole = whole / np.linalg.norm(whole, axis=1, keepdims=True)
    arm = result.adjustment.state.arm
    return probe_effects_mm(network, arm, whole * split.tolerances)


def _row(direction: Mapping[str, float], names: tuple[str, ...]) -> list[float]:
    return [direction.get(name, 0.0) for name in names]
