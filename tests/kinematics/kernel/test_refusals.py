"""What the kernel in C refuses: everything behind these checks trusts the shapes."""

import numpy as np
import pytest

from tests.kinematics.arms import random_geometry

compiled = pytest.importorskip("traverse.kinematics.kernel.compiled")
GEOMETRY = random_geometry(1, 3)
CHAIN = compiled.Chain(GEOMETRY, compiled.runnable_variants()[-1])
ANGLES = np.zeros((5, 3))


@pytest.mark.parametrize("shape", [(3,), (2, 2), (2, 4), (1, 2, 3)])
@pytest.mark.parametrize(
    "of",
    [CHAIN.poses, CHAIN.centres, CHAIN.positions, CHAIN.joint_poses, CHAIN.derivatives],
)
def test_readings_of_another_shape_are_refused(of, shape):
    with pytest.raises(
        ValueError, match=rf"angles_rad has shape .*expected \({shape[0]}, 3\)"
    ):
        of(np.zeros(shape))


@pytest.mark.parametrize("shape", [(4, 3), (15,)])
def test_arrays_that_lie_about_their_shape_are_refused(shape):
    class Lying(np.ndarray):
        shape = (5, 3)

    with pytest.raises(ValueError, match=r"dimensions|memory of another shape"):
        CHAIN.centres(ANGLES, out=np.zeros(shape).view(Lying))


@pytest.mark.parametrize("dtype", [np.int64, np.float32, ">f8"])
def test_readings_of_another_kind_are_refused(dtype):
    with pytest.raises(ValueError, match="expected aligned float64"):
        CHAIN.poses(ANGLES.astype(dtype))


def test_unaligned_readings_are_refused():
    memory = np.zeros(ANGLES.nbytes + 4, np.uint8)
    unaligned = memory[4:].view(np.float64).reshape(5, 3)
    aligned_at = memory.ctypes.data % 8
    with pytest.raises(ValueError, match="expected aligned float64"):
        CHAIN.poses(unaligned if aligned_at == 0 else memory[:-4].view(float))


def test_places_of_another_shape_or_read_only_are_refused():
    with pytest.raises(ValueError, match=r"directions has shape \(4, 3\)"):
        CHAIN.poses(ANGLES, None, np.zeros((4, 3)))
    with pytest.raises(ValueError, match="read-only"):
        CHAIN.centres(ANGLES, out=np.broadcast_to(np.zeros(3), (5, 3)))
    with pytest.raises(ValueError, match="not C-contiguous"):
        CHAIN.positions(ANGLES, out=np.zeros((5, 3, 4)).transpose(0, 2, 1))
    places = CHAIN.derivatives(ANGLES)
    with pytest.raises(ValueError, match="by_axes has shape"):
        CHAIN.derivatives(ANGLES, out=(*places[:2], places[2][:, :, :2], places[3]))


@pytest.mark.parametrize(
    "sample", [[0.0] * 2, [0.0] * 4, (0.0,) * 4, np.zeros(4), np.zeros((1, 3))]
)
def test_one_sample_of_another_length_is_refused(sample):
    with pytest.raises(ValueError, match="expected 3 floats"):
        CHAIN.pose(sample)


def test_one_sample_of_words_is_refused():
    with pytest.raises(TypeError):
        CHAIN.pose(["a", "b", "c"])
    with pytest.raises(TypeError):
        CHAIN.pose(7.0)


def test_list_that_shrinks_while_it_is_read_is_refused():
    class Shrinking:
        def __float__(self):
            del sample[1:]
            return 0.0

    sample = [Shrinking(), 0.0, 0.0]
    with pytest.raises(ValueError, match="expected 3 floats"):
        CHAIN.pose(sample)


def test_arm_of_too_many_joints_and_unknown_variants_are_refused():
    with pytest.raises(ValueError, match="33 joints, expected at most 32"):
        compiled.Chain(random_geometry(1, 33), "portable")
    with pytest.raises(ValueError, match="'avx1024' does not run on this processor"):
        compiled.Chain(GEOMETRY, "avx1024")
