import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.end_to_end.agreement import covariance
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import CONE, DEMO_ARM, Workbench
from traverse.client import Arm, CommandRefused
from traverse.kinematics.arm_file.arm import Identification, read_arm, write_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.uncertainty.arm_covariance import (
    parameter_columns,
    parameter_names,
)

pytestmark = pytest.mark.needs("mosquitto")


def write_covariance(file: Path) -> np.ndarray:
    """Beside the arm file, as an identification leaves it; named by it."""
    arm = read_arm(file)
    names = parameter_names([joint.name for joint in arm.joints], ())
    rng = np.random.default_rng(2)
    scales = np.where(["axis" in name for name in names], 4e-6, 0.004)
    factor = scales[:, np.newaxis] * rng.normal(size=(len(names), 9)) / 3.0
    covariance = factor @ factor.T
    path = file.parent / "arm.cov.npz"
    np.savez(path, names=np.array(names), covariance=covariance)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    known = Identification(covariance_file=path.name, covariance_digest=digest)
    write_arm(file, arm.model_copy(update={"identification": known}))
    return covariance


@pytest.mark.slow
async def test_a_length_between_two_points_with_what_they_share(
    bench: Workbench,
) -> None:
    known = write_covariance(bench.arm_file)
    bench.write_simulator(CONE.format(postures=6))
    bench.write_daemon()
    arm_file = read_arm(bench.arm_file)
    geometry, effects = geometry_from_arm(arm_file), effects_from_arm(arm_file)
    async with (
        measuring(bench) as (listener, _, _),
        Arm(bench.arm, f"{bench.host}:{bench.port}", since="session") as arm,
    ):
        await listener.n_points(3)
        first, *_, last = listener.points
        distance = await arm.distance(first, last.id)
        joint = await arm.covariance([first, last])
        with pytest.raises(CommandRefused, match="is not among the latest 1000 points"):
            await arm.distance(first, "elsewhere")
        with pytest.raises(ValueError, match="at most 100 items"):
            await arm.covariance([first.id] * 101)
    block = Block(np.array([first.angles_rad, last.angles_rad]))
    columns, _ = parameter_columns(geometry, effects, block)
    cross = columns[0] @ known @ columns[1].T
    np.testing.assert_allclose(
        joint.covariance_mm2[:3, 3:], cross, rtol=1e-6, atol=1e-12
    )
    np.testing.assert_allclose(joint.covariance_mm2[:3, :3], covariance(first))
    way_mm = np.subtract(last.xyz_mm, first.xyz_mm)
    assert distance.length_mm == pytest.approx(np.linalg.norm(way_mm))
    n = way_mm / np.linalg.norm(way_mm)
    variance = n @ (covariance(first) + covariance(last) - cross - cross.T) @ n
    assert distance.expanded_mm == pytest.approx(2.0 * np.sqrt(variance), rel=1e-6)
    assert distance.with_arm


async def test_without_a_covariance_of_the_arm_it_is_said(resting: Workbench) -> None:
    shutil.copy(DEMO_ARM, resting.arm_file)
    resting.change("arm.toml", '"demo-7"', f'"{resting.arm}"')
    async with (
        measuring(resting, "doubt"),
        Arm(resting.arm, f"{resting.host}:{resting.port}") as arm,
    ):
        points = [await arm.capture() for _ in range(3)]
        assert {point.covariance_mm2 for point in points} == {None}
        assert all("geometry_unknown" in point.quality.flags for point in points)
        with pytest.raises(CommandRefused, match="not the result of an identification"):
            await arm.covariance(points)
