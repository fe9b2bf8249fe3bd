"""Values of an arm's parameters, and what its family expects of them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.campaign.poses import Poses


@dataclass(frozen=True, slots=True, eq=False)
class ArmValues:
    """Values of all parameters: the geometry and the values of the effects.

    Attributes:
        amplitudes: Values of the effects in the order of the arm file, (n_values,).
        tools_mm: Vectors of the campaign's tools beside the arm's own, (n_tools, 3).
        mountings: Unit quaternions of the instrument's probes in the last body in the
            base posture, of each tool with orientations, (n_mounted, 4).
    """

    geometry: Geometry
    amplitudes: Floats
    tools_mm: Floats = field(default_factory=lambda: np.empty((0, 3)))
    mountings: Floats = field(default_factory=lambda: np.empty((0, 4)))

    def with_tool(self, tool: int) -> "ArmValues":
        """Put on a tool, counted from 1; 0 is the arm's own."""
        if tool == 0:
            return self
        vector_mm = self.tools_mm[tool - 1]
        changed = replace(self.geometry, probe_vector_mm=vector_mm)
        return replace(self, geometry=changed)

    def each_tool(
        self, poses: Poses, compute: Callable[[Geometry, Integers], Floats]
    ) -> Floats:
        """Put together what is computed for the poses of each tool, (n_poses, ...).

        It is computed from the arm with a tool and the indices of its poses, (n,), a
        row a pose.
        """
        if poses.tools is None or not len(poses):
            return compute(self.geometry, np.arange(len(poses)))
        order = np.argsort(poses.tools, kind="stable")
        parts = [
            compute(
                self.with_tool(int(tool)).geometry, np.flatnonzero(poses.tools == tool)
            )
            for tool in np.unique(poses.tools)
        ]
        return np.concatenate(parts)[np.argsort(order)]


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """What an arm's family expects of it.

    Attributes:
        names: Of the parameters that it says something about, (n,).
        stds: (n,).
        arm: With the expected values, and the effects of the design alone.
    """

    names: tuple[str, ...]
    stds: Floats
    arm: ArmValues
