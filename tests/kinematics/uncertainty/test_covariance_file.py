"""A file of a covariance that is too large is refused before it is unpacked."""

import io
import zipfile

import numpy as np
import pytest

from traverse.kinematics.uncertainty.arm_covariance import read_arm_covariance

NAMES = [f"p{k}" for k in range(40)]


def archive(path, **arrays):
    np.savez_compressed(path, **arrays)
    return path


def test_an_archive_of_zeros_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "arm.cov.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("names.npy", b"")
        with made.open("covariance.npy", "w", force_zip64=True) as entry:
            for _ in range(64):
                entry.write(bytes(1 << 20))
    with pytest.raises(ValueError, match="unpacks to 67108864 bytes; an arm of 40"):
        read_arm_covariance(path, NAMES, None)


def test_a_header_that_announces_more_than_there_is_is_refused(tmp_path):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    path = tmp_path / "arm.cov.npz"
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("names.npy", b"")
        made.writestr("covariance.npy", header.getvalue())
    with pytest.raises(ValueError, match="no covariance of an arm"):
        read_arm_covariance(path, NAMES, None)


def test_one_of_the_right_size_is_read(tmp_path):
    path = archive(
        tmp_path / "arm.cov.npz",
        names=np.array(NAMES),
        values=np.zeros(40),
        covariance=np.eye(40),
    )
    np.testing.assert_allclose(
        read_arm_covariance(path, NAMES, None).covariance, np.eye(40), atol=1e-12
    )
