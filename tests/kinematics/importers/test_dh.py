"""Denavit-Hartenberg tables against matrices multiplied out here, and by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import geometries, seeds, size_mm
from tests.kinematics.importers.matrices import rotation
from traverse.kinematics.importers.dh import (
    DHTable,
    geometry_from_dh,
    misfits_mm,
    nearest_table,
    probe_transforms,
)
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import Geometry, unit_vectors

UR10 = DHTable(
    convention="classic",
    a_mm=[0.0, -612.0, -572.3, 0.0, 0.0, 0.0],
    d_mm=[127.3, 0.0, 0.0, 163.941, 115.7, 92.2],
    alpha_rad=[np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0],
    theta_rad=np.zeros(6),
    base=np.eye(4),
    tool=np.eye(4),
)


def shifted(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def multiplied_out(table, angles_rad):
    """The probe's transform, elementary motion by elementary motion."""
    pose = table.base
    for k, angle_rad in enumerate(angles_rad):
        about_z = rotation([0, 0, 1], table.theta_rad[k] + angle_rad)
        along_z = shifted(0, 0, table.d_mm[k])
        along_x = shifted(table.a_mm[k], 0, 0)
        about_x = rotation([1, 0, 0], table.alpha_rad[k])
        if table.convention == "classic":
            pose = pose @ about_z @ along_z @ along_x @ about_x
        else:
            pose = pose @ about_x @ along_x @ about_z @ along_z
    return pose @ table.tool


def random_rigid(rng):
    return shifted(*rng.uniform(-500, 500, 3)) @ rotation(
        unit_vectors(rng.normal(size=3)), rng.uniform(-np.pi, np.pi)
    )


def random_table(seed, n_joints, convention):
    rng = np.random.default_rng(seed)
    return DHTable(
        convention=convention,
        a_mm=rng.uniform(-500, 500, n_joints),
        d_mm=rng.uniform(-500, 500, n_joints),
        alpha_rad=rng.uniform(-np.pi, np.pi, n_joints),
        theta_rad=rng.uniform(-np.pi, np.pi, n_joints),
        base=random_rigid(rng),
        tool=random_rigid(rng),
    )


tables = st.builds(
    random_table, seeds, st.integers(1, 8), st.sampled_from(["classic", "modified"])
)


def random_readings(seed, n_joints, count=5):
    return np.random.default_rng(seed).uniform(-7, 7, (count, n_joints))


@given(tables, seeds)
def test_an_arm_of_a_table_moves_as_the_product_of_its_matrices(table, seed):
    readings_rad = random_readings(seed, table.n_joints)
    geometry = geometry_from_dh(table, readings_rad[0])
    centres_mm, shanks = probe_pose(geometry, readings_rad)
    expected = np.array([multiplied_out(table, row) for row in readings_rad])
    tolerance_mm = 1e-12 * size_mm(geometry)
    np.testing.assert_allclose(
        centres_mm, expected[:, :3, 3], rtol=0, atol=tolerance_mm
    )
    np.testing.assert_allclose(shanks, expected[:, :3, 2], rtol=0, atol=1e-12)


@given(tables, seeds)
def test_probe_transforms_are_the_product_of_the_matrices(table, seed):
    readings_rad = random_readings(seed, table.n_joints)
    expected = np.array([multiplied_out(table, row) for row in readings_rad])
    scale_mm = size_mm(geometry_from_dh(table, readings_rad[0]))
    np.testing.assert_allclose(
        probe_transforms(table, readings_rad), expected, rtol=0, atol=1e-12 * scale_mm
    )


@given(tables, seeds)
def test_a_table_read_off_an_arm_of_a_table_moves_the_same(table, seed):
    readings_rad = random_readings(seed, table.n_joints)
    geometry = geometry_from_dh(table, readings_rad[0])
    repeated = nearest_table(geometry, 1e-9).table
    expected = np.array([multiplied_out(table, row) for row in readings_rad])
    poses = np.array([multiplied_out(repeated, row) for row in readings_rad])
    feet_mm = np.abs([repeated.a_mm, repeated.d_mm]).sum()
    # Nearly parallel hinges have far feet, whose rounding affects the probe.
    tolerance_mm = 1e-12 * (size_mm(geometry) + feet_mm)
    np.testing.assert_allclose(
        poses[:, :3, 3], expected[:, :3, 3], rtol=0, atol=tolerance_mm
    )
    np.testing.assert_allclose(poses[:, :3, 2], expected[:, :3, 2], rtol=0, atol=1e-10)


@given(geometries, seeds)
def test_every_arm_has_a_table_once_base_and_tool_are_free(geometry, seed):
    table = nearest_table(geometry, 1e-9).table
    feet_mm = np.abs([table.a_mm, table.d_mm]).sum()
    misfit_mm = misfits_mm(geometry, table, random_readings(seed, geometry.n_joints))
    assert misfit_mm.max() < 1e-11 * (size_mm(geometry) + feet_mm)


def test_the_zero_posture_of_the_ur10_is_what_the_hand_computes():
    # All in the x-z plane but for d: upper and lower arm along -x; d4 and d6 along the
    # lift's axis, which is -y; d5 hangs down from the shoulder's height.
    by_hand_mm = [-612.0 - 572.3, -163.941 - 92.2, 127.3 - 115.7]
    geometry = geometry_from_dh(UR10, np.zeros(6))
    centre_mm, shank = probe_pose(geometry, np.zeros((1, 6)))
    np.testing.assert_allclose(centre_mm[0], by_hand_mm, rtol=0, atol=1e-10)
    np.testing.assert_allclose(shank[0], [0.0, -1.0, 0.0], rtol=0, atol=1e-12)


@given(seeds)
def test_the_ur10_keeps_its_table_from_any_base_posture(seed):
    posture_rad = np.random.default_rng(seed).uniform(-3, 3, 6)
    nearest = nearest_table(geometry_from_dh(UR10, posture_rad), 1e-6)
    for name in ("a_mm", "d_mm", "alpha_rad", "theta_rad", "base", "tool"):
        np.testing.assert_allclose(
            getattr(nearest.table, name), getattr(UR10, name), rtol=0, atol=1e-9
        )
    assert nearest.parallel.tolist() == [False, True, True, False, False]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_exactly_parallel_hinges_get_the_shortest_table(way):
    geometry = Geometry(
        origin_mm=np.zeros(3),
        axes=[[0.0, 0.0, 1.0], [0.0, 0.0, way], [0.0, 1.0, 0.0]],
        links_mm=[[300.0, 0.0, 40.0], [200.0, 0.0, 0.0], [0.0, 50.0, 0.0]],
        zeros_rad=np.zeros(3),
        probe_vector_mm=np.zeros(3),
        probe_direction=[0.0, 1.0, 0.0],
    )
    nearest = nearest_table(geometry, 1e-9)
    assert nearest.parallel.tolist() == [True, False]
    np.testing.assert_allclose(nearest.table.d_mm, [0.0, way * 40.0, 50.0], atol=1e-12)
    readings_rad = random_readings(1, 3)
    assert misfits_mm(geometry, nearest.table, readings_rad).max() < 1e-10


def test_coaxial_hinges_need_no_offsets():
    geometry = Geometry(
        origin_mm=np.zeros(3),
        axes=[[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]],
        links_mm=[[0.0, 0.0, 100.0], [0.0, 0.0, 100.0]],
        zeros_rad=[0.3, -0.4],
        probe_vector_mm=np.zeros(3),
        probe_direction=[0.0, 0.0, 1.0],
    )
    table = nearest_table(geometry, 1e-9).table
    np.testing.assert_allclose(table.theta_rad, 0.0, atol=1e-15)
    np.testing.assert_allclose(table.d_mm.sum(), 200.0, rtol=1e-15)


def nearly_parallel(tilt_rad):
    """The UR10 with the elbow's axis tilted in the plane across the upper arm."""
    geometry = geometry_from_dh(UR10, np.zeros(6))
    axes = geometry.axes.copy()
    axes[2] = [0.0, -np.cos(tilt_rad), np.sin(tilt_rad)]
    links_mm = geometry.links_mm.copy()
    links_mm[1] += [0.0, 0.0, 0.1]
    return replace(geometry, axes=axes, links_mm=links_mm)


def test_nearly_parallel_hinges_have_their_common_normal_far_away():
    nearest = nearest_table(nearly_parallel(1e-4), 1e-6)
    # 0.1 mm beside each other at 1e-4 rad: the lines pass a metre away.
    assert abs(nearest.table.d_mm[1]) == pytest.approx(1000.0, rel=1e-6)
    assert nearest.between_rad[1] == pytest.approx(1e-4, rel=1e-9)


def test_the_slide_says_how_far_a_tilt_moves_the_common_normal():
    straight, tilt_rad = nearly_parallel(1e-2), 1e-7
    axes = straight.axes.copy()
    axes[2] = unit_vectors(axes[2] + [tilt_rad, 0.0, 0.0])
    before = nearest_table(straight, 1e-9)
    after = nearest_table(replace(straight, axes=axes), 1e-9)
    slide_mm = abs(after.table.d_mm[1] - before.table.d_mm[1])
    # The tilt acts on the lever a; the other lever is small here.
    assert slide_mm / tilt_rad == pytest.approx(before.slide_mm_rad[1], rel=0.02)


def test_hinges_taken_as_parallel_leave_a_misfit_but_none_in_the_base_posture():
    geometry = nearly_parallel(1e-4)
    nearest = nearest_table(geometry, 1e-3)
    misfit_mm = misfits_mm(geometry, nearest.table, random_readings(3, 6, 200))
    at_base_mm = misfits_mm(geometry, nearest.table, geometry.zeros_rad[np.newaxis])
    assert nearest.parallel[1]
    assert at_base_mm[0] < 1e-10
    # At most what turning the arm by the neglected angles would move its end.
    assert 1e-3 < misfit_mm.max() < 2.0 * 1e-4 * 1600.0 + 0.2


def test_a_table_with_ragged_columns_is_refused():
    with pytest.raises(ValueError, match=r"d_mm has shape \(2,\), expected \(3,\)"):
        DHTable(
            "classic",
            np.zeros(3),
            np.zeros(2),
            np.zeros(3),
            np.zeros(3),
            np.eye(4),
            np.eye(4),
        )
