"""The kernel beside NumPy: every variant in turn, round after round, in one run.

Times of a busy machine are worth little; the ratio of two that were taken one right
after the other is worth more, so the medians of such ratios are printed, too.
"""

import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from kinematics.derivatives import numpy_derivatives
from kinematics.forward import numpy_pose
from kinematics.geometry import Geometry, unit_vectors
from kinematics.kernel.choice import KERNELS
from kinematics.kernel.single_pose import PlainChain

try:
    from kinematics.kernel.compiled import Chain
except ImportError:
    sys.exit("the kernel in C is not built, so there is nothing to compare")

N_SAMPLES = 100_000
# So many that their derivatives stay in the cache.
N_DERIVED = 1024
N_SINGLE = 1000
ROUNDS = 25
Task = Callable[[], object]


def arm(n_joints: int = 7) -> Geometry:
    """An arm without any symmetry."""
    rng = np.random.default_rng(1)
    return Geometry(
        origin_mm=rng.uniform(-100, 100, 3),
        axes=unit_vectors(rng.normal(size=(n_joints, 3))),
        links_mm=rng.uniform(-300, 300, (n_joints, 3)),
        zeros_rad=rng.uniform(-3, 3, n_joints),
        probe_vector_mm=np.array([0.0, 0.0, 50.0]),
        probe_direction=np.array([0.0, 0.0, 1.0]),
    )


def tasks() -> dict[str, tuple[int, dict[str, Task]]]:
    """What is measured: how many poses each task computes, and who computes them."""
    geometry = arm()
    angles_rad = np.random.default_rng(2).uniform(-3, 3, (N_SAMPLES, 7))
    some_rad, one_rad = angles_rad[:N_DERIVED], angles_rad[0].tolist()
    chains = {name: Chain(geometry, name) for name in KERNELS[1:]}
    centres_mm, directions = np.empty((N_SAMPLES, 3)), np.empty((N_SAMPLES, 3))
    derived = next(iter(chains.values())).derivatives(some_rad)
    centres: dict[str, Task] = {}
    poses: dict[str, Task] = {"numpy": partial(numpy_pose, geometry, angles_rad)}
    jacobians: dict[str, Task] = {
        "numpy": partial(numpy_derivatives, geometry, some_rad)
    }
    single: dict[str, Task] = {
        "numpy": partial(numpy_pose, geometry, angles_rad[:1]),
        "plain floats": partial(PlainChain(geometry).pose, one_rad),
    }
    for name, chain in chains.items():
        centres[name] = partial(chain.centres, angles_rad, out=centres_mm)
        poses[name] = partial(chain.poses, angles_rad, centres_mm, directions)
        jacobians[name] = partial(chain.derivatives, some_rad, out=derived)
        single[f"{name}, centre"] = partial(chain.centre, one_rad)
        single[f"{name}, pose"] = partial(chain.pose, one_rad)
    return {
        f"centre, batch of {N_SAMPLES}": (N_SAMPLES, centres),
        f"pose, batch of {N_SAMPLES}": (N_SAMPLES, poses),
        f"centre and all derivatives, batch of {N_DERIVED}": (N_DERIVED, jacobians),
        "one pose from Python": (1, single),
    }


def times_ns(n_poses: int, who: dict[str, Task]) -> dict[str, list[float]]:
    """Time all in turn, round after round: ns a pose."""
    repeats = range(N_SINGLE if n_poses == 1 else 1)
    found: dict[str, list[float]] = {name: [] for name in who}
    for _ in range(ROUNDS):
        for name, task in who.items():
            begun_s = time.perf_counter()
            for _ in repeats:
                task()
            taken_s = time.perf_counter() - begun_s
            found[name].append(1e9 * taken_s / (n_poses * len(repeats)))
    return found


def main() -> None:
    """Print the figures, and as JSON as the last line."""
    print(f"load of the machine: {os.getloadavg()[0]:.2f}, cores: {os.cpu_count()}")
    report: dict[str, dict[str, dict[str, float]]] = {}
    for what, (n_poses, who) in tasks().items():
        print(what)
        times = times_ns(n_poses, who)
        first = next(iter(times))
        report[what] = {}
        for name, taken in times.items():
            low, median, high = np.percentile(taken, (10, 50, 90))
            ratio = float(np.median(np.divide(times[first], taken)))
            print(
                f"  {name:18} {median:9.1f} ns ({low:.1f} to {high:.1f}), least "
                f"{min(taken):.1f}; {ratio:6.2f} times {first}"
            )
            report[what][name] = {"median_ns": median, "ratio": ratio}
    print(json.dumps(report))


if __name__ == "__main__":
    main()
