"""Distribution of an arm's mass, as far as the poses determine it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.lab.identification.results.undetermined import named
from traverse.lab.identification.solve.adjustment import Adjustment

# Part of what is assumed up to which a combination counts as determined.
_DETERMINED = 0.5


@dataclass(frozen=True, slots=True)
class MassDistribution:
    """First moments of mass that were estimated since no mass is known.

    Attributes:
        mass_kg: That the whole arm is assumed to have: only compliances times masses
            show in poses.
        moments_kg_m: Of each element with all beyond it, by its joint's name.
        determined: Combinations that the poses determine, components by name in units
            of the assumed standard deviations, of unit length together.
        stds: Of these, as parts of the assumed ones.
        n_directions: Of all combinations; the rest is as assumed.
    """

    mass_kg: float
    moments_kg_m: dict[str, tuple[float, ...]]
    determined: tuple[dict[str, float], ...]
    stds: tuple[float, ...]
    n_directions: int


def mass_distribution(adjustment: Adjustment) -> MassDistribution | None:
    """Return what an adjustment says about masses; None where it did not estimate any.

    Directions are those of the covariance over the assumed variances.
    """
    parameters = adjustment.network.parameters
    model = parameters.effects
    if model is None or model.assumed is None:
        return None
    first = parameters.n_geometric
    own = [first + at for at in model.moments if parameters.free[first + at]]
    if not own:
        return None
    moments = model.at(adjustment.state.arm.amplitudes).first_moments
    names = model.effects.joint_names
    stds_kg_m = np.zeros(len(parameters.names))
    joints = [one.joints.start for one in moments]
    stds_kg_m[[first + at for at in model.moments]] = np.repeat(
        model.assumed.stds_kg_m[joints], 3
    )
    columns = np.searchsorted(np.flatnonzero(parameters.free), own)
    white = adjustment.split.inverse[columns] / stds_kg_m[own][:, np.newaxis]
    squares, directions = np.linalg.eigh(white @ white.T)
    known = squares < _DETERMINED**2
    among_all = np.zeros((np.count_nonzero(known), parameters.n_free))
    among_all[:, columns] = directions.T[known]
    return MassDistribution(
        mass_kg=model.assumed.mass_kg,
        moments_kg_m={
            names[j]: one.values for j, one in zip(joints, moments, strict=True)
        },
        determined=tuple(named(parameters, direction) for direction in among_all),
        stds=tuple(np.sqrt(squares[known]).tolist()),
        n_directions=len(own),
    )


def mass_distribution_json(adjustment: Adjustment) -> dict[str, Any]:
    """Put it into plain values; nothing where masses are known or do not matter."""
    found = mass_distribution(adjustment)
    if found is None:
        return {}
    return {
        "mass_distribution": {
            "assumed_mass_kg": found.mass_kg,
            "first_moments_kg_m": found.moments_kg_m,
            "determined": [
                {"direction": direction, "std": std}
                for direction, std in zip(found.determined, found.stds, strict=True)
            ],
            "combinations": found.n_directions,
        }
    }
