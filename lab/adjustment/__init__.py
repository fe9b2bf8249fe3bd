"""The least-squares adjustment of an arm's parameters.

A `Problem` is a campaign with an arm's values and parameters; its `Network` holds the
equations of the poses that take part. `adjust` solves these, and `adjust_iteratively`
does so until neither the poses that take part nor the noise change.
"""

from traverse.lab.adjustment.adjusted import Adjustment
from traverse.lab.adjustment.iterate import IteratedAdjustment, adjust_iteratively
from traverse.lab.adjustment.noise import Noise
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.pose_statistics import PoseStatistics
from traverse.lab.adjustment.prepare import IdentificationError, Options, Problem
from traverse.lab.adjustment.problem import Network
from traverse.lab.adjustment.solve import adjust
from traverse.lab.adjustment.starting_values import find_starting_values

__all__ = [
    "Adjustment",
    "ArmValues",
    "IdentificationError",
    "IteratedAdjustment",
    "Network",
    "Noise",
    "Options",
    "PoseStatistics",
    "Problem",
    "adjust",
    "adjust_iteratively",
    "find_starting_values",
]
