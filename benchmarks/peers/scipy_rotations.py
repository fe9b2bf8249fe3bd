"""scipy's rotations, all samples at once."""

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """`Rotation.from_rotvec` of all samples at once, joint by joint from the tip."""
    steps_mm = offsets_mm(geometry)

    def batch(turns_rad: Floats) -> Floats:
        vectors_mm = np.zeros((len(turns_rad), 3))
        for k in reversed(range(geometry.n_joints)):
            turns = Rotation.from_rotvec(turns_rad[:, k : k + 1] * geometry.axes[k])
            vectors_mm = turns.apply(vectors_mm + steps_mm[k + 1])
        return vectors_mm + steps_mm[0]

    return Peer("scipy Rotation", scipy.__version__, batch=batch)
