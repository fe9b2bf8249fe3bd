"""Names for the same thing: how near two effects are.

Correlations are those of the blocks as the data see them, the unknowns projected out.
"""

import numpy as np

from traverse.arrays import Floats
from traverse.lab.diagnosis.candidates.scoring import ProjectedCandidate

# Two blocks that explain a finding equally well to this part are one.
ALIAS = 0.9995


def is_alias(rho: float) -> bool:
    """Say whether a correlation is that of two names of one thing."""
    return rho >= ALIAS


def canonical_correlations(
    first: ProjectedCandidate, second: ProjectedCandidate
) -> Floats:
    """Compute those of two blocks, the largest first, (n_common,)."""
    values = np.linalg.svd(first.directions.T @ second.directions, compute_uv=False)
    found: Floats = np.clip(values, 0.0, 1.0)
    return found
