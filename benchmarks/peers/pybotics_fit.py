"""The same arms by pybotics, in an environment of its own: it needs an older NumPy.

    python -m venv DIR && DIR/bin/pip install pybotics scipy
    python -m benchmarks.strangers DATA --pybotics DIR/bin/python

Reads one set as JSON from standard input: classic Denavit-Hartenberg rows, readings,
places seen by a tracker and which poses were kept aside; answers with the distances
[mm] of these. Modified rows, tool and place of the arm are free, and scipy minimises
the distances that pybotics computes, as its documentation shows.
"""

import json
import sys

import numpy as np
from pybotics.kinematic_chain import MDHKinematicChain
from pybotics.optimization import (
    OptimizationHandler,
    compute_absolute_errors,
    optimize_accuracy,
)
from pybotics.robot import Robot
from scipy.optimize import least_squares

from benchmarks.tools.command_line import run_main


def modified(rows: np.ndarray) -> np.ndarray:
    """Modified rows (alpha, a, theta, d) of classic ones (a, d, alpha)."""
    before = np.vstack([np.zeros(3), rows[:-1]])
    zeros = np.zeros(len(rows))
    return np.column_stack([before[:, 2], before[:, 0], zeros, rows[:, 1]])


def placed(robot: Robot, angles_rad: np.ndarray, places_mm: np.ndarray) -> np.ndarray:
    """The arm's place that fits best, a matrix (Kabsch 1976)."""
    positions = np.array([robot.fk(q)[:3, 3] for q in angles_rad])
    positions = (positions - robot.world_frame[:3, 3]) @ robot.world_frame[:3, :3]
    middle, centre = positions.mean(axis=0), places_mm.mean(axis=0)
    u, _, v = np.linalg.svd((positions - middle).T @ (places_mm - centre))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    frame = np.eye(4)
    frame[:3, :3] = (u @ sign @ v).T
    frame[:3, 3] = centre - frame[:3, :3] @ middle
    return frame


def main() -> None:
    request = json.load(sys.stdin)
    angles_rad, places_mm = (
        np.array(request["angles_rad"]),
        np.array(request["places_mm"]),
    )
    kept = np.array(request["is_kept"])
    robot = Robot(
        MDHKinematicChain.from_parameters(modified(np.array(request["rows"])))
    )
    robot.tool.position = np.array(request["tool_mm"])
    robot.world_frame = placed(robot, angles_rad[~kept], places_mm[~kept])
    handler = OptimizationHandler(
        robot,
        kinematic_chain_mask=[True] * robot.kinematic_chain.num_parameters,
        tool_mask=[True, True, True, False, False, False],
        world_mask=[True] * 6,
    )
    fit = least_squares(
        optimize_accuracy,
        handler.generate_optimization_vector(),
        args=(handler, angles_rad[~kept], places_mm[~kept]),
        x_scale="jac",
        max_nfev=60,
    )
    handler.apply_optimization_vector(fit.x)
    best = handler.robot
    if request["was_moved"]:
        best.world_frame = placed(best, angles_rad[kept], places_mm[kept])
    distances_mm = compute_absolute_errors(angles_rad[kept], places_mm[kept], best)
    json.dump({"distances_mm": distances_mm.tolist()}, sys.stdout)


if __name__ == "__main__":
    run_main(main)
