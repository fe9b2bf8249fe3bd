import os
import subprocess
import sys
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from tests.kinematics.arms import geometries, random_geometry, seeds, size_mm
from tests.running import run_program
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.kernel.terms import Form, Term
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import (
    joint_positions,
    numpy_pose,
    probe_centre,
    probe_pose,
)
from traverse.kinematics.model.geometry import Coupling
from traverse.kinematics.model.kernel_choice import (
    KERNEL,
    KERNELS,
    chosen_kernel,
    compiled_chain,
)
from traverse.kinematics.model.single_pose import PlainChain, pose_function

if KERNEL != "numpy":
    from traverse.kinematics.kernel.compiled import DeflectedChain

ROOT = Path(__file__).parents[3]


def run_python(
    kernel: str, *arguments: str, status: int = 0
) -> subprocess.CompletedProcess[str]:
    return run_program(
        sys.executable,
        *arguments,
        cwd=ROOT,
        env={**os.environ, "TRAVERSE_KERNEL": kernel},
        status=status,
    )


def test_fastest_kernel_is_chosen_unless_another_one_is_requested():
    assert chosen_kernel(None, ("numpy", "portable", "avx2")) == "avx2"
    assert chosen_kernel("", ("numpy",)) == "numpy"
    assert chosen_kernel("portable", ("numpy", "portable", "avx2")) == "portable"
    with pytest.raises(ValueError, match="'avx2', which does not run here; expected"):
        chosen_kernel("avx2", ("numpy", "portable"))


@pytest.mark.parametrize("kernel", KERNELS)
def test_environment_names_the_kernel(kernel):
    run = run_python(
        kernel,
        "-c",
        "from traverse.kinematics.model.kernel_choice import KERNEL; print(KERNEL)",
    )
    assert run.stdout.strip() == kernel


def test_commands_refuse_an_unknown_kernel_in_a_sentence():
    run = run_python(
        "abacus", "-m", "traverse", "arm", "show", "nowhere.toml", status=2
    )
    (line,) = run.stderr.splitlines()
    assert line.startswith("traverse: TRAVERSE_KERNEL is 'abacus'")
    assert "expected one of numpy" in line


@pytest.mark.slow
def test_laws_of_the_kinematics_hold_without_the_kernel():
    run_python(
        "numpy",
        *("-m", "pytest", "-q", "-p", "no:cacheprovider"),
        *(
            "tests/kinematics/model/test_forward.py",
            "tests/kinematics/model/test_derivatives.py",
        ),
    )


@pytest.mark.skipif(KERNEL == "numpy", reason="NumPy runs")
@pytest.mark.parametrize("with_effects", [False, True])
def test_gil_is_free_while_a_block_is_computed(with_effects):
    """With threads never made to yield, another one runs only where the GIL is let go.

    How soon the system wakes it is not ours to say, hence the repetitions.
    """
    geometry = random_geometry(1, 7)
    chain = compiled_chain(geometry)
    assert chain is not None
    angles, centres = np.zeros((100_000, 7)), np.empty((100_000, 3))
    compute = partial(chain.centres, angles, out=centres)
    if with_effects:
        tilt = Term(form=Form.TILT_MOMENT, values=(1e-6,), joint=2)
        deflected = DeflectedChain(geometry, KERNEL, [tilt], geometry.links_mm)
        compute = partial(
            deflected.poses, Block(angles), (0.0, 0.0, -9.8), centres, centres.copy()
        )
    expected, ran = threading.Lock(), []
    expected.acquire()

    def wait():
        with expected:
            ran.append(True)

    thread = threading.Thread(target=wait)
    thread.start()
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000.0)
    try:
        expected.release()
        for _ in range(2000):
            compute()
            if ran:
                break
        assert ran
    finally:
        sys.setswitchinterval(interval)
        thread.join()


@settings(max_examples=50)
@given(geometries, seeds)
def test_plain_floats_agree_with_numpy(geometry, seed):
    angles = np.random.default_rng(seed).uniform(-8, 8, (3, geometry.n_joints))
    chain = PlainChain(geometry)
    for sample, centre, direction in zip(
        angles, *numpy_pose(geometry, angles), strict=True
    ):
        pose_of_sample = chain.pose(sample.tolist())
        assert pose_of_sample == chain.pose(sample)
        atol = 1e-14 * geometry.n_joints
        np.testing.assert_allclose(pose_of_sample[1], direction, rtol=0, atol=atol)
        atol *= size_mm(geometry)
        np.testing.assert_allclose(pose_of_sample[0], centre, rtol=0, atol=atol)


def test_plain_floats_pass_on_what_is_no_number():
    chain = PlainChain(random_geometry(1, 3))
    for spoilt in ([0.0, np.inf, 0.0], [np.nan, 0.0, 0.0]):
        assert np.isnan(chain.pose(spoilt)).all()


def test_plain_floats_refuse_another_number_of_readings():
    with pytest.raises(ValueError, match="expected 3 floats"):
        PlainChain(random_geometry(1, 3)).pose([0.0, 1.0])


@pytest.mark.parametrize("couplings", [(), (Coupling(2, 1, -1.0),)])
def test_one_pose_is_that_of_the_block(couplings):
    geometry = replace(random_geometry(2, 7), couplings=couplings)
    angles = np.random.default_rng(1).uniform(-3, 3, (4, 7))
    pose = pose_function(geometry)
    for sample, centre, direction in zip(
        angles, *probe_pose(geometry, angles), strict=True
    ):
        pose_of_sample = pose(sample.tolist())
        np.testing.assert_allclose(pose_of_sample[0], centre, rtol=0, atol=1e-11)
        np.testing.assert_allclose(pose_of_sample[1], direction, rtol=0, atol=1e-14)


@pytest.mark.parametrize("n_samples", [1, 2, 40])
def test_readings_are_taken_however_they_lie(n_samples):
    geometry = random_geometry(1, 3)
    angles = np.random.default_rng(1).uniform(-3, 3, (n_samples, 3))
    packed = np.zeros(n_samples, np.dtype([("status", "u1"), ("angles", "f8", 3)]))
    packed["angles"] = angles
    for other in (packed["angles"], angles.astype(">f8"), np.asfortranarray(angles)):
        for of in (probe_pose, joint_positions, probe_derivatives):
            computed, expected = of(geometry, other), of(geometry, angles)
            if of is probe_derivatives:
                computed, expected = computed.by_axes, expected.by_axes
            assert np.array_equal(computed, expected)
    rounded = np.round(angles)
    computed = probe_centre(geometry, rounded.astype(np.int64))
    assert np.array_equal(computed, probe_centre(geometry, rounded))


def test_arm_with_more_joints_than_the_kernel_takes_is_computed_by_numpy():
    geometry = random_geometry(1, 33)
    assert compiled_chain(geometry) is None
    angles = np.random.default_rng(1).uniform(-3, 3, (4, 33))
    computed, expected = probe_pose(geometry, angles), numpy_pose(geometry, angles)
    assert computed[0].tobytes() == expected[0].tobytes()
