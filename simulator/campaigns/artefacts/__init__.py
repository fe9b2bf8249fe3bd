"""Artefacts that campaigns touch: one file each."""

from traverse.simulator.campaigns.artefacts.artefact import AnyArtefact, Artefact
from traverse.simulator.campaigns.artefacts.seats import Cone, DrawWire, Points, Seats
from traverse.simulator.campaigns.artefacts.surfaces import (
    BallBar,
    ParallelPlanes,
    Plane,
    Sphere,
)

Artefact.KINDS.update(
    {
        "cone": Cone,
        "seats": Seats,
        "ball_bar": BallBar,
        "sphere": Sphere,
        "plane": Plane,
        "parallel_planes": ParallelPlanes,
        "points": Points,
        "draw_wire": DrawWire,
    }
)
