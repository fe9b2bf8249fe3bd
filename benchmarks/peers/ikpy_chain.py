"""ikpy: a chain of links as in a URDF."""

from importlib.metadata import version

import numpy as np
from ikpy.chain import Chain
from ikpy.link import OriginLink, URDFLink

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """`forward_kinematics` of a chain of links as in a URDF."""
    steps_mm = offsets_mm(geometry)
    joints = [
        URDFLink(f"J{k + 1}", steps_mm[k], np.zeros(3), rotation=axis)
        for k, axis in enumerate(geometry.axes)
    ]
    ball = URDFLink("ball", steps_mm[-1], np.zeros(3), joint_type="fixed")
    mask = [False, *(True for _ in joints), False]
    chain = Chain([OriginLink(), *joints, ball], active_links_mask=mask)

    def one(turns_rad: Floats) -> Floats:
        return chain.forward_kinematics([0.0, *turns_rad, 0.0])[:3, 3]

    return Peer("ikpy", version("ikpy"), one)
