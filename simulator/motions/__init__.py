"""Motions that the virtual arm can be scripted to do: one file each."""

from simulator.motions.motion import KINDS, AnyMotion, Motion
from simulator.motions.rest import Rest
from simulator.motions.sphere import Sphere

__all__ = ["KINDS", "AnyMotion", "Motion"]

KINDS.update(
    {
        "rest": Rest,
        "sphere": Sphere,
    }
)
