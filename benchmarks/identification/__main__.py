"""`python -m benchmarks.identification.__main__`: time and memory of the adjustment.

Beside scipy's least squares on the same problem, each in a process of its own with one
thread of linear algebra, so that peak memory is its own. Seconds are of the processor,
hardly affected by other load.

Numerical derivatives are differences of hundreds of forward computations, which our
kernel speeds up tenfold. So this peer runs twice: with the kernel, and with vectorised
NumPy.
"""

import argparse
import json
import os
import pickle
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.identification.problem import DensePeer, large_campaign, problem
from benchmarks.proofs.conditions import demo_arm
from benchmarks.tools.sizes import sized
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment.solve import adjust
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.identify import identify

SIZES = sized((500, 5_000, 50_000, 500_000), (100,))
# Beyond these a peer takes more minutes or memory than it is worth.
MOST_POSES = {"2-point": 50_000, "2-point-numpy": 50_000, "dense": 50_000}
METHODS = ("adjust", "identify", "2-point", "2-point-numpy", "dense")
SCAN_POSES = sized(1_000_000, 500)
REPEATS = sized(3, 1)  # of the small ones; the best counts


def measured(method: str, campaign: Campaign) -> dict[str, Any]:
    arm = demo_arm()
    start_problem = problem(campaign, arm)
    before_kb = _peak_kb()
    times_s: list[float] = []
    geometry, n_iterations = start_problem.start.arm.geometry, 0
    n_repeats = REPEATS if len(campaign.poses) <= 5_000 else 1
    while len(times_s) < n_repeats:
        begun_s = time.process_time()
        if method == "adjust":
            adjusted = adjust(
                start_problem.network, start_problem.start, start_problem.start.arm
            )
            geometry = adjusted.state.arm.geometry
            n_iterations = len(adjusted.iterations)
        elif method == "identify":
            result = identify(campaign, arm)
            geometry = result.adjustment.state.arm.geometry
            n_iterations = len(result.iterations)
        else:
            fit = DensePeer(start_problem).solve(numerical=method != "dense")
            geometry, n_iterations = fit.state.arm.geometry, fit.n_jacobians
        times_s.append(time.process_time() - begun_s)
    return {
        "seconds": min(times_s),
        "iterations": n_iterations,
        "peak_mb": _peak_kb() / 1024.0,
        "own_mb": (_peak_kb() - before_kb) / 1024.0,
        "distances_mm": _distances(geometry),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.identification.__main__"
    )
    parser.add_argument("--method", choices=METHODS)
    parser.add_argument("--campaign", type=Path, help="one that was made before")
    parser.add_argument("--sizes", type=int, nargs="*", default=SIZES)
    parser.add_argument("--scan", type=int, default=SCAN_POSES)
    options = parser.parse_args(arguments)
    if options.method is not None:
        # What is read here was written a moment ago by this program.
        campaign = pickle.loads(options.campaign.read_bytes())
        print(json.dumps(measured(options.method, campaign)))
        return
    print(f"load of the machine: {os.getloadavg()[0]:.2f}, cores: {os.cpu_count()}")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.pickle"
        _compare(options.sizes, path)
        if options.scan:
            path.write_bytes(pickle.dumps(large_campaign("scan", options.scan)))
            for method in ("adjust", "identify"):
                result = _in_a_process(method, path)
                shown = _shown(method, result)
                print(f"scan of one sphere, {options.scan} poses: {shown}")
    print(f"load afterwards: {os.getloadavg()[0]:.2f}")


def _compare(sizes: Sequence[int], path: Path) -> None:
    times_s: dict[str, list[tuple[int, float]]] = {method: [] for method in METHODS}
    for n_poses in sizes:
        path.write_bytes(pickle.dumps(large_campaign("mixed", n_poses)))
        ours: dict[str, Any] | None = None
        for method in METHODS:
            if n_poses > MOST_POSES.get(method, n_poses):
                continue
            result = _in_a_process(method, path)
            times_s[method].append((n_poses, result["seconds"]))
            ours = ours or result
            ratio = result["seconds"] / ours["seconds"]
            gaps_mm = np.subtract(result["distances_mm"], ours["distances_mm"])
            print(
                f"{n_poses:>7} poses  {_shown(method, result)}, {ratio:6.2f} x adjust, "
                f"distances differ by {np.max(np.abs(gaps_mm)):.1e} mm",
                flush=True,
            )
    for method, points in times_s.items():
        large = [point for point in points if point[0] >= 5_000]
        if len(large) > 1:
            logs = np.log(np.array(large))
            exponent = np.polyfit(logs[:, 0], logs[:, 1], 1)[0]
            print(f"{method}: time grows with poses to the power {exponent:.2f}")


def _in_a_process(method: str, path: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.identification.__main__"]
    kernel = {"TRAVERSE_KERNEL": "numpy"} if method.endswith("-numpy") else {}
    done = subprocess.run(
        [*command, "--method", method, "--campaign", str(path)],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **kernel},
        check=True,
        capture_output=True,
        text=True,
    )
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _shown(method: str, result: dict[str, Any]) -> str:
    return (
        f"{method:<13} {result['seconds']:8.3f} s, "
        f"{result['iterations']:>2} iterations, "
        f"peak {result['peak_mb']:6.0f} MB (of it {result['own_mb']:.0f} MB beyond the "
        "campaign)"
    )


def _distances(geometry: Geometry) -> list[float]:
    """Distances between random postures, which do not depend on the datum."""
    turns_rad = np.random.default_rng(5).uniform(-1.2, 1.2, (40, geometry.n_joints))
    centres_mm = probe_centre(geometry, geometry.zeros_rad + turns_rad)
    distances_mm = np.linalg.norm(centres_mm[::2] - centres_mm[1::2], axis=1)
    return [float(distance_mm) for distance_mm in distances_mm]


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    main()
