"""Artefacts that campaigns touch: one file each."""

from traverse.simulator.campaigns.artefacts.artefact import KINDS, AnyArtefact, Artefact
from traverse.simulator.campaigns.artefacts.ball_bar import BallBar
from traverse.simulator.campaigns.artefacts.cone import Cone
from traverse.simulator.campaigns.artefacts.parallel_planes import ParallelPlanes
from traverse.simulator.campaigns.artefacts.plane import Plane
from traverse.simulator.campaigns.artefacts.points import Points
from traverse.simulator.campaigns.artefacts.sphere import Sphere

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

KINDS.update(
    {
        "cone": Cone,
        "ball_bar": BallBar,
        "sphere": Sphere,
        "plane": Plane,
        "parallel_planes": ParallelPlanes,
        "points": Points,
    }
)
