"""The datum: which components are held so that the arm cannot move as a whole.

Turning or shifting the whole arm changes nothing that artefacts without a system
of their own determine. Written in the parameters, these six motions are known
exactly; components are held until none of the motions is left. Which ones is chosen
by pivoting on the motions scaled by the parameters' tolerances: the held components
are then those that a motion changes most, so that the choice is well conditioned
whatever the arm looks like. What changed parameters do at the probe is told without
such motions: it does not depend on the datum.
"""

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment.parameters import Parameters

_NULL = 1e-9
NO_TOOLS = np.empty((0, 3))


def rigid_motions(
    parameters: Parameters, geometry: Geometry, tools_mm: Floats = NO_TOOLS
) -> Floats:
    """Write three turns about x_0 and three shifts in all parameters, (n_all, 6).

    A turn e changes u_k by e x u_k, mountings by e and r_k by e x r_k. The part of the
    latter along u_k goes into r_(k-1) with equal effect, and so on down to x_0.
    """
    n = geometry.n_joints
    basis = parameters.basis(geometry)
    motions = np.zeros((len(parameters.names), 6))
    for column, turn in enumerate(np.eye(3)):
        axes = np.cross(turn, geometry.axes)
        links_mm = np.cross(turn, geometry.links_mm)
        links_mm, origin_mm = _handed_inwards(geometry, links_mm)
        joints = np.stack(
            [
                np.einsum("kbi,ki->kb", basis, axes),
                np.einsum("kbi,ki->kb", basis, links_mm),
            ],
            axis=1,
        )
        motions[: 4 * n, column] = joints.ravel()
        motions[4 * n : 4 * n + 3, column] = origin_mm
        probe = slice(4 * n + 3, 4 * n + 6)
        motions[probe, column] = np.cross(turn, geometry.probe_vector_mm)
        # The last link has the probe vector's turn, for the other tools, too.
        beyond_mm = tools_mm - geometry.probe_vector_mm
        motions[parameters.of_tools, column] = np.cross(turn, beyond_mm).ravel()
        mountings = slice(parameters.of_tools.stop, parameters.n_geometric)
        motions[mountings, column] = np.tile(turn, len(parameters.mounted))
    # The probe vector turns with the last link: held, its turn is the link's.
    motions[4 * n : 4 * n + 3, 3:] = np.eye(3)
    return _probe_moved_into_links(parameters, geometry, motions)


def _probe_moved_into_links(
    parameters: Parameters, geometry: Geometry, motions: Floats
) -> Floats:
    """Replace changes of the probe vector by equal ones of the last links."""
    n = geometry.n_joints
    basis = parameters.basis(geometry)
    moved = motions.copy()
    probe, of_joints = slice(4 * n + 3, 4 * n + 6), moved[: 4 * n].reshape(n, 4, 6)
    for column in range(6):
        links_mm = np.zeros((n, 3))
        links_mm[-1] = moved[probe, column]
        moved[probe, column] = 0.0
        links_mm, origin_mm = _handed_inwards(geometry, links_mm)
        of_joints[:, 2:, column] += np.einsum("kbi,ki->kb", basis, links_mm)
        moved[4 * n : 4 * n + 3, column] += origin_mm
    return moved


def _handed_inwards(geometry: Geometry, links_mm: Floats) -> tuple[Floats, Floats]:
    """Hand what links have along their axes to the next inner ones, in the end to x_0.

    Returns the links, (n_joints, 3), now across their axes, and that of x_0, (3,).
    """
    across_mm, along_mm = links_mm.copy(), np.zeros(3)
    for k in reversed(range(geometry.n_joints)):
        across_mm[k] += along_mm
        along_mm = (across_mm[k] @ geometry.axes[k]) * geometry.axes[k]
        across_mm[k] -= along_mm
    return across_mm, along_mm


def free_motions(motions: Floats, free: Booleans) -> Floats:
    """Combine motions so that held parameters do not move, (n_all, n_left)."""
    sizes = np.linalg.norm(motions, axis=0)
    scaled = motions / np.maximum(sizes, 1e-300)
    held = scaled[~free]
    if len(held) == 0:
        return motions
    _, values, right = np.linalg.svd(held)
    rank = int(np.count_nonzero(values > _NULL))
    left: Floats = scaled @ right[rank:].T
    return left


def with_datum(
    parameters: Parameters,
    geometry: Geometry,
    preferred: Booleans | None = None,
    tools_mm: Floats = NO_TOOLS,
) -> Parameters:
    """Hold as many components as there are motions left, the best ones.

    They are chosen among the preferred ones, (n_all,), by default among all. The zero
    of the first joint is held too: it turns the arm as a whole. Tools beside the arm's
    own have vectors, (n_tools, 3).
    """
    motions = rigid_motions(parameters, geometry, tools_mm)
    left = free_motions(motions, parameters.free)
    free = parameters.free.copy()
    free[4 * parameters.n_joints + 6] = False
    candidates = free if preferred is None else free & preferred
    rows = np.where(candidates[:, np.newaxis], left, 0.0)
    rows = rows / parameters.tolerances[:, np.newaxis]
    for _ in range(left.shape[1]):
        sizes = np.linalg.norm(rows, axis=1)
        best = int(np.argmax(sizes))
        free[best] = False
        unit = rows[best] / sizes[best]
        rows = rows - np.outer(rows @ unit, unit)
    return parameters.with_free(free)


def scale_direction(
    parameters: Parameters, geometry: Geometry, tools_mm: Floats = NO_TOOLS
) -> Floats:
    """Return the direction of a stretch of the whole arm.

    In units of the tolerances, of unit length, (1, n_free), or (0, n_free).
    """
    scaled = stretch(parameters, geometry, tools_mm) / parameters.free_tolerances
    size = float(np.linalg.norm(scaled))
    return scaled / size if size > 0.0 else scaled[:0]


def stretch(
    parameters: Parameters, geometry: Geometry, tools_mm: Floats = NO_TOOLS
) -> Floats:
    """Write a stretch of the whole arm to twice its size in the free parameters.

    Links grow by themselves; held components are kept by turning the arm back. (1,
    n_free); none, (0, n_free), where held parameters keep the arm from stretching.
    """
    n = geometry.n_joints
    basis = parameters.basis(geometry)
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    step = np.zeros(len(parameters.names))
    # A shift of x_0 along the first axis moves the arm as a whole.
    links_mm, step[4 * n : 4 * n + 3] = _handed_inwards(geometry, links_mm)
    step[: 4 * n].reshape(n, 4)[:, 2:] = np.einsum("kbi,ki->kb", basis, links_mm)
    beyond_mm = tools_mm - geometry.probe_vector_mm
    step[parameters.of_tools] = beyond_mm.ravel()
    motions = rigid_motions(parameters, geometry, tools_mm)
    held = ~parameters.free
    turned = np.linalg.lstsq(motions[held], step[held], rcond=1e-9)[0]
    without_motions = step - motions @ turned
    if np.max(np.abs(without_motions[held])) > 1e-6 * max(
        float(np.max(np.abs(step))), 1e-9
    ):
        return np.empty((0, parameters.n_free))
    return without_motions[np.newaxis, parameters.free]
