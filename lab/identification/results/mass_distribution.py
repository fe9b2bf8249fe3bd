"""Distribution of an arm's mass, as far as the poses determine it."""

from typing import Any

import numpy as np

from traverse.lab.identification.results.undetermined import named
from traverse.lab.identification.solve.adjustment import Adjustment

# Part of what is assumed up to which a combination counts as determined.
_DETERMINED = 0.5


def mass_distribution(adjustment: Adjustment) -> dict[str, Any]:
    """Say what was estimated of masses, as reports and JSON files have it.

    Combinations are those of the covariance over the assumed variances, their `std` a
    part of the assumed one; empty where no first moment was estimated for want of
    masses.
    """
    parameters = adjustment.network.parameters
    model = parameters.effects
    if model is None or model.assumed is None:
        return {}
    is_moment = np.zeros(len(parameters.names), dtype=np.bool_)
    is_moment[parameters.n_geometric :][model.moments] = True
    is_free = parameters.free[is_moment]
    if not np.any(is_free):
        return {}
    joints = model.effects.joint_names
    moments = model.at(adjustment.state.arm.amplitudes).first_moments
    stds_kg_m = model.assumed.stds_of(moments)[is_free]
    own = is_moment[parameters.free]
    white = adjustment.split.inverse[own] / stds_kg_m[:, np.newaxis]
    squares, directions = np.linalg.eigh(white @ white.T)
    combinations = np.zeros((len(squares), parameters.n_free))
    combinations[:, own] = directions.T
    return {
        "assumed_mass_kg": model.assumed.mass_kg,
        "first_moments_kg_m": {joints[m.joints.start]: m.values for m in moments},
        "determined": [
            {"direction": named(parameters, combination), "std": float(np.sqrt(square))}
            for square, combination in zip(squares, combinations, strict=True)
            if square < _DETERMINED**2
        ],
        "combinations": len(squares),
    }
