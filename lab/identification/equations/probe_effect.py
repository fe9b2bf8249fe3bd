"""Effect of changed parameters at the probe, in mm."""

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import N_RIGID, motions
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.lab.identification.equations.network import Network
from traverse.lab.identification.equations.parameters import ArmValues

_N_POSTURES = 300
_LEAST_RANGE_RAD = np.radians(120.0)
_SEED = 20_170_101


def probe_effects_mm(network: Network, arm: ArmValues, steps: Floats) -> Floats:
    """Compute the root mean square shift of the probe by each step, (n_steps,).

    Over random postures within the travelled ranges, but at least 120 degrees a
    joint: an arm is identified to be used. The motion of the arm as a whole is
    taken out: it depends on the datum only. Steps are those of the free parameters,
    (n_steps, n_free).
    """
    columns, centres_mm = posture_columns(network, arm)
    shifts_mm = np.einsum("nip,sp->nis", columns, steps).reshape(-1, len(steps))
    local_mm = centres_mm - centres_mm.mean(axis=0)
    basis = np.linalg.qr(motions(local_mm, N_RIGID).reshape(-1, N_RIGID))[0]
    rest_mm = shifts_mm - basis @ (basis.T @ shifts_mm)
    effects: Floats = np.sqrt(np.sum(rest_mm**2, axis=0) / len(centres_mm))
    return effects


def posture_columns(network: Network, arm: ArmValues) -> tuple[Floats, Floats]:
    """Compute derivatives (n, 3, n_free) and centres (n, 3) at random postures.

    Effects are left out: their columns need more than a posture.
    """
    angles_rad = network.campaign.poses.angles_rad[network.poses]
    rng = np.random.default_rng(_SEED)
    least, largest = angles_rad.min(axis=0), angles_rad.max(axis=0)
    wider_rad = np.maximum(0.5 * (_LEAST_RANGE_RAD - (largest - least)), 0.0)
    postures_rad = rng.uniform(
        least - wider_rad, largest + wider_rad, (_N_POSTURES, angles_rad.shape[1])
    )
    derivatives = probe_derivatives(arm.geometry, postures_rad)
    parameters = network.parameters
    geometric = parameters.of_geometry()
    columns = np.zeros((_N_POSTURES, 3, parameters.n_free))
    columns[:, :, : geometric.n_free] = geometric.columns(
        arm, derivatives, network.campaign.poses.part(slice(0))
    )
    return columns, derivatives.centres_mm
