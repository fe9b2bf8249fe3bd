"""Motions that the virtual arm can be scripted to do: one file each."""

from traverse.simulator.motions.ball_bar import BallBar
from traverse.simulator.motions.cone import Cone
from traverse.simulator.motions.motion import KINDS, AnyMotion, Motion
from traverse.simulator.motions.plane import Plane
from traverse.simulator.motions.replay import ReplayMotion
from traverse.simulator.motions.rest import RestMotion
from traverse.simulator.motions.sphere import Sphere
from traverse.simulator.motions.sweep import Sweep

__all__ = ["KINDS", "AnyMotion", "Motion", "ReplayMotion"]

KINDS.update(
    {
        "rest": RestMotion,
        "cone": Cone,
        "sphere": Sphere,
        "ball_bar": BallBar,
        "plane": Plane,
        "sweep": Sweep,
        "replay": ReplayMotion,
    }
)
