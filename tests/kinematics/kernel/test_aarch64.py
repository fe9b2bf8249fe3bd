import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.kinematics.arms import random_geometry
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.kernel.terms import Form, Term

compiled = pytest.importorskip("traverse.kinematics.kernel.compiled")

ROOT = Path(__file__).parent.parent.parent.parent
COMPILER, EMULATOR = "aarch64-linux-gnu-gcc", "qemu-aarch64"
pytestmark = pytest.mark.needs("aarch64")

# Those of kernel_poses.c.
TERMS = (
    Term(form=Form.READING_WAVE, joint=1, order=3, values=(1e-4, -2e-4)),
    Term(form=Form.TURN_MOMENT, joint=0, values=(1e-7,)),
    Term(form=Form.TILT_MOMENT, joint=1, values=(1e-7,)),
    Term(form=Form.MOUNT_MOMENT, values=(1e-7,)),
    Term(form=Form.SHIFT_WAVE, joint=1, order=1, values=(0.1, 0.0, 0.0, 0.0, 0.2, 0.0)),
    Term(form=Form.TILT_WAVE, order=2, values=(1e-4, 0.0, 0.0, 0.0, 2e-4, 0.0)),
)


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    """The kernel with the flags of setup.py, which has none for processors."""
    made = tmp_path_factory.mktemp("aarch64") / "poses"
    kernel = ROOT / "kinematics" / "kernel"
    main = ROOT / "tests" / "kinematics" / "kernel" / "native" / "kernel_poses.c"
    flags = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-static", "-Wall")
    sources = (str(kernel / "variants.c"), str(main))
    subprocess.run(
        [COMPILER, *flags, f"-I{kernel}", *sources, "-lm", "-o", str(made)], check=True
    )
    return made


def computed(program: Path, geometry, angles_rad) -> list[np.ndarray]:
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    n_samples, n_joints = angles_rad.shape
    stdin = np.array([n_joints, n_samples], dtype="<i8").tobytes()
    for values in (geometry.zeros_rad, geometry.axes, links_mm, geometry.origin_mm):
        stdin += values.astype("<f8").tobytes()
    stdin += geometry.probe_direction.astype("<f8").tobytes()
    stdin += np.ascontiguousarray(angles_rad).astype("<f8").tobytes()
    run = subprocess.run(
        [EMULATOR, str(program)], input=stdin, capture_output=True, check=True
    )
    shapes = [
        (n_samples, 3),
        (n_samples, 3),
        (n_samples, 3, n_joints),
        (n_samples, 3, n_joints, 3),
        (n_samples, 3, n_joints, 3),
        (2, 3),
        (n_samples, 3),
        (n_samples, 3),
    ]
    ends = np.cumsum([np.prod(shape) for shape in shapes])
    parts = np.split(np.frombuffer(run.stdout, "<f8"), ends)
    assert len(parts[-1]) == 0
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=False)]


@pytest.mark.parametrize("n_joints", [2, 6, 7, 9])
def test_aarch64_gives_the_bits_of_this_machine(program, n_joints):
    geometry = random_geometry(n_joints, n_joints)
    rng = np.random.default_rng(n_joints)
    angles_rad = np.vstack(
        [
            rng.uniform(-8.0, 8.0, (70, n_joints)),
            rng.uniform(-1e4, 1e4, (37, n_joints)),
            np.full((1, n_joints), np.nan),
        ]
    )
    centres, directions, by_angles, by_axes, by_links, single, *deflected = computed(
        program, geometry, angles_rad
    )

    chain = compiled.Chain(geometry, "portable")
    np.testing.assert_array_equal(centres, chain.centres(angles_rad))
    np.testing.assert_array_equal(directions, chain.poses(angles_rad)[1])
    expected = chain.derivatives(angles_rad)
    for derivative, of_this_machine in zip(
        (by_angles, by_axes, by_links), expected[1:], strict=True
    ):
        np.testing.assert_array_equal(derivative, of_this_machine)
    np.testing.assert_array_equal(single, chain.pose(angles_rad[0].tolist()))
    # The links of this arm go without the probe vector, as the program takes them.
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    bare = replace(geometry, links_mm=links_mm, probe_vector_mm=np.zeros(3))
    chain = compiled.DeflectedChain(bare, "portable", TERMS, links_mm)
    expected = chain.poses(Block(angles_rad), [0.5, 1.0, -9.5])
    for derivative, of_this_machine in zip(deflected, expected, strict=True):
        np.testing.assert_array_equal(derivative, of_this_machine)
