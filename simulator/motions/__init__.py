"""Motions that the virtual arm can be scripted to do: one file each."""

from traverse.simulator.motions.cone import Cone
from traverse.simulator.motions.motion import (
    AnyMotion,
    Motion,
    ReplayMotion,
    RestMotion,
)
from traverse.simulator.motions.surfaces import BallBar, Plane, Sphere, Sweep

Motion.KINDS.update(
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
