"""The named parameters of an arm: their values, which are free, how they move.

Joint k has four: its axis turns by a_k v_k + b_k w_k and its link changes by
c_k v_k + d_k w_k, with v_k, w_k across u_k. The component of a link along its axis
is left alone, because x does not change when a hinge slides along its own axis.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.model.derivatives import ProbeDerivatives, turn_derivatives
from traverse.kinematics.model.geometry import Geometry, unit_vectors
from traverse.kinematics.model.quaternion import (
    conjugate,
    multiply,
    rotation_vectors,
    small_turn,
)
from traverse.lab.adjustment.effect_model import EffectModel
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


# Components smaller than this part of the largest are not named.
_NAMED = 0.1


@lru_cache(maxsize=8)
def _basis(geometry: Geometry, smallest: tuple[int, ...]) -> Floats:
    """Build a basis; an iteration needs that of a geometry many times."""
    unit = np.eye(3)[list(smallest)]
    along = np.einsum("ki,ki->k", unit, geometry.axes)[:, np.newaxis]
    v = unit_vectors(unit - along * geometry.axes)
    basis = np.stack([v, np.cross(geometry.axes, v)], axis=1)
    basis.setflags(write=False)
    return basis


@dataclass(frozen=True, slots=True, eq=False)
class Parameters:
    """All parameters of an arm, and which of them are free.

    Attributes:
        names: `J3.axis.v`, ..., `origin.x`, ..., `probe.vector.x`, ..., `J3.zero`,
            ..., `tool.NAME.x`, ..., `probe.mounting.x`, `tool.NAME.mounting.x`, ...,
            and those of the effects, (n_all,).
        units: "" for axes (radians of a small turn), mm, rad; as effects say.
        tolerances: Plausible deviations from the design, (n_all,).
        free: Which are estimated, (n_all,).
        smallest: The component of each design axis that v_k is built from.
        effects: Of the arm, or None.
        expected: By the arm's family, or None.
        mounted: Numbers of the tools with orientations, rising; 0: the arm's own.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    tolerances: Floats
    free: Booleans
    smallest: tuple[int, ...]
    effects: EffectModel | None = None
    n_tools: int = 0
    expected: Expected | None = None
    mounted: tuple[int, ...] = ()

    @property
    def of_tools(self) -> slice:
        """Indices of the vectors of tools."""
        first = 5 * self.n_joints + 6
        return slice(first, first + 3 * self.n_tools)

    @property
    def n_geometric(self) -> int:
        """Number of parameters before those of the effects."""
        return 5 * self.n_joints + 6 + 3 * (self.n_tools + len(self.mounted))

    @property
    def n_joints(self) -> int:
        return len(self.smallest)

    @property
    def n_free(self) -> int:
        return int(np.count_nonzero(self.free))

    @property
    def free_names(self) -> tuple[str, ...]:
        """Names of the free ones, in the order of the columns."""
        return tuple(n for n, free in zip(self.names, self.free, strict=True) if free)

    @property
    def free_units(self) -> tuple[str, ...]:
        return tuple(u for u, free in zip(self.units, self.free, strict=True) if free)

    @property
    def free_tolerances(self) -> Floats:
        """Tolerances of the free ones, (n_free,)."""
        return self.tolerances[self.free]

    @property
    def required_effects(self) -> EffectModel:
        """The effects.

        Raises:
            ValueError: There are none.
        """
        if self.effects is None:
            raise ValueError("the adjustment has no effects")
        return self.effects

    def with_free(self, free: Booleans) -> "Parameters":
        return replace(self, free=free)

    def with_effects_larger(self, factor: float) -> "Parameters":
        """Let effects plausibly be so many times as large; weights stay as they are."""
        if self.effects is None:
            return self
        factors = np.full(len(self.effects.names), factor)
        factors[self.effects.moments] = 1.0  # weight is no error
        tolerances = self.tolerances.copy()
        tolerances[-len(factors) :] *= factors
        effects = replace(self.effects, tolerances=factors * self.effects.tolerances)
        return replace(self, tolerances=tolerances, effects=effects)

    def of_geometry(self) -> "Parameters":
        n_kept = self.n_geometric
        return Parameters(
            self.names[:n_kept],
            self.units[:n_kept],
            self.tolerances[:n_kept],
            self.free[:n_kept],
            self.smallest,
            n_tools=self.n_tools,
            mounted=self.mounted,
        )

    def basis(self, geometry: Geometry) -> Floats:
        """Build (v_k, w_k) across every axis as it is now, (n_joints, 2, 3)."""
        return _basis(geometry, self.smallest)

    def columns(
        self, values: ArmValues, derivatives: ProbeDerivatives, poses: Poses
    ) -> Floats:
        """Compute dx for the free parameters, (n_poses, 3, n_free).

        All poses are of one tool.
        """
        n_poses, n = len(derivatives.centres_mm), self.n_joints
        tool = 0 if poses.tools is None or not len(poses) else int(poses.tools[0])
        by_axes, by_links, by_zeros = self._maps(values.geometry, tool)
        # A small product a pose: a single large one would be shared between threads,
        # which costs more than it saves.
        columns: Floats = derivatives.by_axes.reshape(n_poses, 3, -1) @ by_axes
        columns += derivatives.by_links.reshape(n_poses, 3, -1) @ by_links
        if np.any(by_zeros):
            columns += derivatives.by_zeros @ by_zeros
        if np.any(self.free[4 * n : 4 * n + 3]):
            n_left = len(self.names) - 4 * n - 3
            columns += np.pad(np.eye(3), ((0, 0), (4 * n, n_left)))[:, self.free]
        self._put_effects(columns, values.with_tool(tool), poses, turns=False)
        return columns

    def _put_effects(
        self, columns: Floats, values: ArmValues, poses: Poses, *, turns: bool
    ) -> None:
        """Put in the columns of free effects."""
        free = self.free[self.n_geometric :]
        if self.effects is not None and np.any(free):
            moves = self.effects.columns(
                values.geometry, values.amplitudes, poses, turns=turns
            )
            columns[:, :, -np.count_nonzero(free) :] = moves[:, :, free]

    def turn_columns(
        self, values: ArmValues, derivatives: ProbeDerivatives, poses: Poses
    ) -> Floats:
        """Compute small turns of the instrument's probe, (n_poses, 3, n_free) [rad].

        For the free parameters, as `columns`; of a tool with orientations.
        """
        n_poses = len(derivatives.centres_mm)
        tool = 0 if poses.tools is None else int(poses.tools[0])
        by_axes, _, by_zeros = self._maps(values.geometry, tool)
        by_angles, turned = turn_derivatives(values.geometry, derivatives)
        columns: Floats = turned.reshape(n_poses, 3, -1) @ by_axes
        columns -= by_angles @ by_zeros
        by_mounting = np.zeros((3, len(self.names)))
        first = self.of_tools.stop + 3 * self.mounted.index(tool)
        by_mounting[:, first : first + 3] = np.eye(3)
        columns += derivatives.by_probe_vector @ by_mounting[:, self.free]
        self._put_effects(columns, values.with_tool(tool), poses, turns=True)
        return columns

    def _maps(self, geometry: Geometry, tool: int) -> tuple[Floats, Floats, Floats]:
        """Write components of axes, links and zeros in the free parameters."""
        basis, n = self.basis(geometry), self.n_joints
        by_axes = np.zeros((3 * n, len(self.names)))
        by_links = np.zeros((3 * n, len(self.names)))
        by_zeros = np.zeros((n, len(self.names)))
        for k in range(n):
            of_joint = slice(3 * k, 3 * k + 3)
            by_axes[of_joint, 4 * k : 4 * k + 2] = basis[k].T
            by_links[of_joint, 4 * k + 2 : 4 * k + 4] = basis[k].T
        vector = 5 * n + 3 + 3 * tool if tool else 4 * n + 3
        by_links[-3:, vector : vector + 3] = np.eye(3)
        by_zeros[:, 4 * n + 6 : 5 * n + 6] = np.eye(n)
        # A choice of columns is stored column by column, which multiplies slowly.
        return (
            np.ascontiguousarray(by_axes[:, self.free]),
            np.ascontiguousarray(by_links[:, self.free]),
            np.ascontiguousarray(by_zeros[:, self.free]),
        )

    def moved(self, values: ArmValues, step: Floats) -> ArmValues:
        """Apply a step of the free parameters, (n_free,); axes stay unit vectors."""
        full = np.zeros(len(self.names))
        full[self.free] = step
        geometry, n = values.geometry, self.n_joints
        basis = self.basis(geometry)
        joints = full[: 4 * n].reshape(n, 4)
        of_arm = full[4 * n :]
        moved = replace(
            geometry,
            axes=unit_vectors(
                geometry.axes + np.einsum("kb,kbi->ki", joints[:, :2], basis)
            ),
            links_mm=geometry.links_mm + np.einsum("kb,kbi->ki", joints[:, 2:], basis),
            origin_mm=geometry.origin_mm + of_arm[:3],
            probe_vector_mm=geometry.probe_vector_mm + of_arm[3:6],
            zeros_rad=geometry.zeros_rad + of_arm[6 : 6 + n],
        )
        first = self.n_geometric - 4 * n
        tools_mm = values.tools_mm + full[self.of_tools].reshape(-1, 3)
        turns = full[self.of_tools.stop : self.n_geometric].reshape(-1, 3)
        mountings = multiply(small_turn(turns.T), values.mountings.T).T
        amplitudes = values.amplitudes
        if self.effects is not None:
            # Vectors stay across or along axes.
            before = self.effects.directions(geometry)
            after = self.effects.directions(moved)
            amplitudes = after @ (after.T @ (amplitudes + before @ of_arm[first:]))
        return ArmValues(moved, amplitudes, tools_mm, mountings)

    def as_expected(self, arm: ArmValues) -> ArmValues:
        """Give an arm the values that its family expects, if it has one."""
        if self.expected is None:
            return arm
        expected = self.expected.arm
        amplitudes = arm.amplitudes.copy()  # added effects are behind the design's
        amplitudes[: len(expected.amplitudes)] = expected.amplitudes
        return replace(arm, geometry=expected.geometry, amplitudes=amplitudes)

    def expectations(self, arm: ArmValues) -> Floats:
        """White equations of the free parameters: by the arm's family, of masses.

        The right side is last, (n, n_free + 1).
        """
        of_family = self.family_expectations(arm)
        if self.effects is None:
            return of_family
        free = self.free[self.n_geometric :]
        of_masses = self.effects.expectations(arm.amplitudes, free)
        rows = np.zeros((len(of_masses), self.n_free + 1))
        rows[:, self.n_free - np.count_nonzero(free) :] = of_masses[:, [*free, True]]
        return np.vstack([of_family, rows])

    def named(self, direction: Floats) -> dict[str, float]:
        """Name the larger components of a direction of the free ones, largest first."""
        least = _NAMED * float(np.max(np.abs(direction)))
        order = np.argsort(-np.abs(direction))
        names = self.free_names
        return {
            names[index]: float(direction[index])
            for index in order
            if abs(direction[index]) >= least
        }

    def family_expectations(self, arm: ArmValues) -> Floats:
        """As `expectations`, by the family alone; n is that of its free parameters."""
        if self.expected is None:
            return np.empty((0, self.n_free + 1))
        expected, names = self.expected, self.free_names
        step = self.coordinates(self.as_expected(arm), arm)[self.free]
        known = np.array([name in names for name in expected.names], dtype=np.bool_)
        columns = [names.index(name) for name in expected.names if name in names]
        rows = np.zeros((len(columns), self.n_free + 1))
        rows[np.arange(len(columns)), columns] = 1.0
        rows[:, -1] = step[columns]
        return rows / expected.stds[known, np.newaxis]

    def length_errors(self, values: ArmValues, artefact: str) -> tuple[float, Floats]:
        """Return by how many ppm a standard is off, and which parameters say so."""
        by_free = np.zeros(self.n_free)
        if self.effects is None:
            return 0.0, by_free
        error_ppm, by_values = self.effects.length_errors(values.amplitudes, artefact)
        by_all = np.zeros(len(self.names))
        by_all[len(self.names) - len(by_values) :] = by_values
        return error_ppm, by_all[self.free]

    def coordinates(self, to: ArmValues, at: ArmValues) -> Floats:
        """Return the step of all parameters from `at` to `to`, (n_all,)."""
        start, end = at.geometry, to.geometry
        basis = self.basis(start)
        difference = to.amplitudes - at.amplitudes
        if self.effects is not None:
            difference = self.effects.directions(start).T @ difference
        joints = np.concatenate(
            [
                np.einsum("kbi,ki->kb", basis, end.axes - start.axes),
                np.einsum("kbi,ki->kb", basis, end.links_mm - start.links_mm),
            ],
            axis=1,
        )
        return np.concatenate(
            [
                joints.ravel(),
                end.origin_mm - start.origin_mm,
                end.probe_vector_mm - start.probe_vector_mm,
                end.zeros_rad - start.zeros_rad,
                (to.tools_mm - at.tools_mm).ravel(),
                rotation_vectors(
                    multiply(to.mountings.T, conjugate(at.mountings.T))
                ).T.ravel(),
                difference,
            ]
        )
