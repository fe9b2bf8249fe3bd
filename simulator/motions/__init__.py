"""Motions that the virtual arm can be scripted to do: one file each."""

from simulator.motions.ball_bar import BallBar
from simulator.motions.cone import Cone
from simulator.motions.motion import KINDS, AnyMotion, Motion
from simulator.motions.plane import Plane
from simulator.motions.replay import Replay
from simulator.motions.rest import Rest
from simulator.motions.sphere import Sphere
from simulator.motions.sweep import Sweep

__all__ = ["KINDS", "AnyMotion", "Motion", "Replay"]

KINDS.update(
    {
        "rest": Rest,
        "cone": Cone,
        "sphere": Sphere,
        "ball_bar": BallBar,
        "plane": Plane,
        "sweep": Sweep,
        "replay": Replay,
    }
)
