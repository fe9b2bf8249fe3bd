"""The covariance of a term's values, for the band about its curve."""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.lab.diagnosis.model.result import Diagnosis, Term


def value_covariance(diagnosis: Diagnosis, term: Term, effects: ArmEffects) -> Floats:
    """Find the covariance of the values of a term.

    From the final fit, scaled to the standard deviations reported for the term;
    of a term that is not in it, those alone.

    Returns:
        (n_values, n_values), in the order of the effect's values.
    """
    stds = np.zeros(len(effects.values))
    correction = effects.corrections[0]
    fitted = _fitted_covariance(diagnosis, effects)
    if term.candidate.is_curve and fitted is not None:
        # Its mean is the joint's zero: the fit holds it, single values do not know.
        return fitted
    for at, name in enumerate(correction.parameters):
        key, dot, part = name.partition(".")
        told = term.estimates.get(key)
        if told is not None:
            place = "xyz".index(part) if part in ("x", "y", "z") else int(part or 1) - 1
            stds[at] = float(
                np.ravel(told.std)[place] if dot else np.ravel(told.std)[0]
            )
    correlation = np.eye(len(stds))
    if fitted is not None:
        sizes = np.sqrt(np.maximum(np.diag(fitted), 0.0))
        safe = np.where(sizes > 0.0, sizes, 1.0)
        correlation = fitted / np.outer(safe, safe)
    found: Floats = stds[:, np.newaxis] * correlation * stds
    return found


def _fitted_covariance(diagnosis: Diagnosis, effects: ArmEffects) -> Floats | None:
    """Find the covariance of the values in the final fit; None: not all are in it."""
    adjustment = diagnosis.all_terms
    parameters = adjustment.network.parameters
    model = parameters.effects
    if model is None:
        return None
    wanted = effects.name(effects.corrections[0])
    corrections = model.effects.corrections
    names = [model.effects.name(correction) for correction in corrections]
    if wanted not in names:
        return None
    index = names.index(wanted)
    geometry = adjustment.state.arm.geometry
    free = [c.free_directions(geometry).shape[1] for c in corrections]
    first = len(parameters.names) - sum(free) + sum(free[:index])
    own = np.arange(first, first + free[index])
    places = np.flatnonzero(parameters.free)
    if not np.all(np.isin(own, places)):
        return None
    inverse = adjustment.split.inverse[np.searchsorted(places, own)]
    directions = corrections[index].free_directions(geometry)
    covariance = directions @ (inverse @ inverse.T) @ directions.T
    found: Floats = adjustment.sigma0**2 * covariance
    return found
