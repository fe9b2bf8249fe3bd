"""Artefacts that campaigns touch: one file each."""

from traverse.simulator.campaigns.artefacts.artefact import AnyArtefact, Artefact
from traverse.simulator.campaigns.artefacts.seats import Cone, Points
from traverse.simulator.campaigns.artefacts.surfaces import (
    BallBar,
    ParallelPlanes,
    Plane,
    Sphere,
)

__all__ = [
    "AnyArtefact",
    "Artefact",
    "BallBar",
    "Cone",
    "ParallelPlanes",
    "Plane",
    "Points",
    "Sphere",
]

Artefact.KINDS.update(
    {
        "cone": Cone,
        "ball_bar": BallBar,
        "sphere": Sphere,
        "plane": Plane,
        "parallel_planes": ParallelPlanes,
        "points": Points,
    }
)
