"""`python -m benchmarks.kinematics [FILE]`: the kernel beside NumPy and others.

All compute the same arm, of seven joints without any symmetry, and are compared before
they are timed. Peers are given turns, alpha - alpha0; Traverse subtracts by itself.
"""

import contextlib
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.peers.installed import check_agreement, installed_peers
from benchmarks.peers.peer import Peer
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import ROUNDS, Table, Task, report, timed
from benchmarks.tools.sizes import sized
from traverse.arrays import Floats
from traverse.kinematics.model.derivatives import numpy_derivatives
from traverse.kinematics.model.forward import numpy_centre, numpy_pose
from traverse.kinematics.model.geometry import Geometry, unit_vectors
from traverse.kinematics.model.kernel_choice import KERNELS
from traverse.kinematics.model.single_pose import PlainChain

# Not built, it is not there, and KERNELS has only NumPy then.
with contextlib.suppress(ImportError):
    from traverse.kinematics.kernel.compiled import Chain

N_SAMPLES = sized(100_000, 500)
# So many that their derivatives stay in the cache.
N_DERIVED = sized(1024, 16)
STEP = 1e-6
COMPILED = KERNELS[1:]


def arm(n_joints: int = 7) -> Geometry:
    rng = np.random.default_rng(1)
    return Geometry(
        origin_mm=rng.uniform(-100, 100, 3),
        axes=unit_vectors(rng.normal(size=(n_joints, 3))),
        links_mm=rng.uniform(-300, 300, (n_joints, 3)),
        zeros_rad=rng.uniform(-3, 3, n_joints),
        probe_vector_mm=np.array([0.0, 0.0, 50.0]),
        probe_direction=np.array([0.0, 0.0, 1.0]),
    )


def single(geometry: Geometry, angles_rad: Floats, peers: list[Peer]) -> list[Task]:
    one_rad = angles_rad[0].tolist()
    turns_rad = angles_rad[0] - geometry.zeros_rad
    tasks = [
        Task("numpy", partial(numpy_pose, geometry, angles_rad[:1])),
        Task("plain floats", partial(PlainChain(geometry).pose, one_rad)),
    ]
    for name in COMPILED:
        chain = Chain(geometry, name)
        tasks.append(Task(f"{name}, centre", partial(chain.centre, one_rad)))
        tasks.append(Task(f"{name}, pose", partial(chain.pose, one_rad)))
    tasks += [
        Task(peer.name, partial(peer.one, turns_rad), is_peer=True)
        for peer in peers
        if peer.one is not None
    ]
    return tasks


def batch(geometry: Geometry, angles_rad: Floats, peers: list[Peer]) -> list[Task]:
    n = len(angles_rad)
    centres_mm, directions = np.empty((n, 3)), np.empty((n, 3))
    turns_rad = angles_rad - geometry.zeros_rad
    tasks = [
        Task("numpy, centre", partial(numpy_centre, geometry, angles_rad), n),
        Task("numpy, pose", partial(numpy_pose, geometry, angles_rad), n),
    ]
    for name in COMPILED:
        chain = Chain(geometry, name)
        centre = partial(chain.centres, angles_rad, out=centres_mm)
        pose = partial(chain.poses, angles_rad, centres_mm, directions)
        tasks += [Task(f"{name}, centre", centre, n), Task(f"{name}, pose", pose, n)]
    for peer in peers:
        if peer.batch is not None:
            call = partial(peer.batch, turns_rad)
            tasks.append(Task(peer.name, call, n, is_peer=True))
    return tasks


def jacobian(geometry: Geometry, angles_rad: Floats, peers: list[Peer]) -> list[Task]:
    n = len(angles_rad)
    tasks = [Task("numpy", partial(numpy_derivatives, geometry, angles_rad), n)]
    out = numpy_derivatives(geometry, angles_rad)
    places = (out.centres_mm, out.by_angles, out.by_axes, out.by_links)
    for name in COMPILED:
        chain = Chain(geometry, name)
        tasks.append(Task(name, partial(chain.derivatives, angles_rad, out=places), n))
    differences = Differences(geometry, COMPILED[-1], angles_rad)
    tasks.append(Task("differences", differences.compute, n, is_peer=True))
    for peer in peers:
        if peer.derivatives is not None:
            call = partial(peer.derivatives, angles_rad - geometry.zeros_rad)
            name = f"{peer.name}, angles only"
            tasks.append(Task(name, call, n, is_peer=True))
    return tasks


class Differences:
    """The same derivatives by forward differences over the same kernel."""

    def __init__(self, geometry: Geometry, variant: str, angles_rad: Floats) -> None:
        self._chains = [Chain(changed, variant) for changed in _changed(geometry)]
        self._nominal = Chain(geometry, variant)
        self._angles_rad = angles_rad
        n_joints = geometry.n_joints
        self._changed_rad = [
            angles_rad + STEP * np.eye(n_joints)[k] for k in range(n_joints)
        ]
        n_columns = n_joints + len(self._chains)
        self.differences = np.empty((n_columns, len(angles_rad), 3))

    def compute(self) -> Floats:
        """One evaluation a parameter and one more: (n_parameters, n_samples, 3)."""
        differences, nominal = self.differences, self._nominal
        centres_mm = nominal.centres(self._angles_rad)
        columns = iter(differences)
        for angles_rad in self._changed_rad:
            nominal.centres(angles_rad, out=next(columns))
        for chain in self._chains:
            chain.centres(self._angles_rad, out=next(columns))
        differences -= centres_mm
        differences /= STEP
        return differences


def _changed(geometry: Geometry) -> Iterator[Geometry]:
    """Yield the arm with each component of an axis or link a little larger."""
    fields = {name: getattr(geometry, name) for name in Geometry.__dataclass_fields__}
    for name in ("axes", "links_mm"):
        for place in np.ndindex(geometry.n_joints, 3):
            values = fields[name].copy()
            values[place] += STEP
            if name == "axes":
                values = unit_vectors(values)
            yield Geometry(**{**fields, name: values})


def tables(
    n_samples: int = N_SAMPLES, n_derived: int = N_DERIVED, rounds: int = ROUNDS
) -> Iterator[Table]:
    """Compare with the installed peers, then time everything."""
    geometry = arm()
    angles_rad = np.random.default_rng(2).uniform(-3, 3, (n_samples, 7))
    peers, missing = installed_peers(geometry)
    for peer in peers:
        largest_mm = check_agreement(geometry, peer, angles_rad[:100])
        print(f"{peer.name} {peer.version} agrees within {largest_mm:.1e} mm")
    if missing:
        print(f"not installed here: {', '.join(missing)}")
    yield timed("one pose, from Python", single(geometry, angles_rad, peers), rounds)
    many = batch(geometry, angles_rad, peers)
    yield timed(f"batch of {n_samples} poses", many, rounds)
    derived = jacobian(geometry, angles_rad[:n_derived], peers)
    yield timed(f"centre and all derivatives, {n_derived} poses", derived, rounds)


def main(path: Path | None = None) -> None:
    if not COMPILED:
        sys.exit("the kernel in C is not built, so there is nothing to compare")
    report(tables(), path)


if __name__ == "__main__":
    run_main(main)
