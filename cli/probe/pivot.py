"""A probe checked by pivoting in a cone: the result beside the previous vector."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.pose.probe_library import LibraryProbe, ProbeLibrary, with_probe
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_from_arm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.kinematics.probing.pivot import Pivot, fit_pivot
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.report.quantities import picked
from traverse.plurals import counted
from traverse.strict_toml.problems import FileError, Problem
from traverse.strict_toml.rewriting import rewritten_text
from traverse.strict_toml.writing import write_atomically


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """Result of pivoting.

    Attributes:
        cone: the artefact in which the ball sat.
        n: how many poses.
        pivot: the fit.
        known_mm: the previous vector, (3,).
        off_mm: how far the found one is from it.
        off_sigma: the same in standard deviations of the found one (Mahalanobis).
    """

    cone: str
    n: int
    pivot: Pivot
    known_mm: Floats
    off_mm: float
    off_sigma: float

    def report(self) -> dict[str, Any]:
        pivot = self.pivot
        return {
            **picked(self, "cone", poses="n"),
            "std_mm": np.sqrt(np.diag(pivot.covariance_mm2)).tolist(),
            "covariance_mm2": six_of(pivot),
            **picked(pivot, "vector_mm", "seat_mm", "rms_mm", "redundancy"),
            **picked(self, "off_mm", "off_sigma", known_vector_mm="known_mm"),
        }

    def lines(self) -> list[str]:
        pivot = self.pivot
        std_mm = np.sqrt(np.diag(pivot.covariance_mm2))
        shown = ", ".join(
            f"{value:.4f} +- {std:.4f}"
            for value, std in zip(pivot.vector_mm, std_mm, strict=True)
        )
        return [
            f"{counted(self.n, 'pose')} in {self.cone}: rms {pivot.rms_mm:.4f} mm (of "
            "the "
            f"balls' distances from the seat), redundancy {pivot.redundancy}",
            f"vector {shown} mm (standard deviations)",
            f"known  {', '.join(f'{value:.4f}' for value in self.known_mm)} mm",
            f"off by {self.off_mm:.4f} mm, {self.off_sigma:.1f} standard deviations",
        ]


def six_of(pivot: Pivot) -> list[float]:
    """xx, xy, xz, yy, yz, zz of the vector's covariance."""
    rows, columns = np.triu_indices(3)
    return [float(value) for value in pivot.covariance_mm2[rows, columns]]


def pivoted(
    folder: Path, arm: Arm, probe: LibraryProbe | None, cone: str | None
) -> Check:
    """Fit the probe's vector to the poses of a cone.

    Args:
        folder: of the campaign.
        arm: with its effects, which are corrected; none of the touch, in a cone.
        probe: the previous probe; None: the arm's own.
        cone: id of the artefact; None where there is only one cone.

    Raises:
        FileError: the campaign is wrong, or has no such cone.
        ValueError: too few poses, or they hardly differ.
    """
    if probe is not None:
        arm = with_probe(arm, probe)
    campaign = read_campaign(folder, [joint.name for joint in arm.joints])
    index = _cone(folder, campaign, cone)
    rows = campaign.poses.artefacts == index
    geometry = geometry_from_arm(arm)
    block = campaign.block(campaign.poses.part(rows))
    fitted = fit_pivot(
        geometry.probe_vector_mm,
        *_balls(geometry, effects_from_arm(arm), replace(block, directions=None)),
    )
    off_mm = fitted.vector_mm - geometry.probe_vector_mm
    weighed = np.linalg.lstsq(fitted.covariance_mm2, off_mm, rcond=None)[0]
    return Check(
        campaign.artefacts[index].id,
        len(block),
        fitted,
        geometry.probe_vector_mm,
        float(np.linalg.norm(off_mm)),
        float(np.sqrt(max(float(off_mm @ weighed), 0.0))),
    )


def _balls(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> tuple[Floats, Floats]:
    """Compute ball centres, (n, 3), and derivatives by the probe's vector, (n, 3, 3).

    By differences, which are exact but for rounding: a ball moves linearly with the
    vector, nearly so on a bending arm.
    """
    centres_mm, _, _ = corrected_pose(geometry, effects, block)
    by_vector = np.empty((*centres_mm.shape, 3))
    for axis, step_mm in enumerate(np.eye(3)):
        longer_mm = geometry.probe_vector_mm + step_mm
        longer = replace(geometry, probe_vector_mm=longer_mm)
        by_vector[..., axis] = corrected_pose(longer, effects, block)[0] - centres_mm
    return centres_mm, by_vector


def write_vector(
    path: Path, library: ProbeLibrary, name: str, pivot: Pivot
) -> ProbeLibrary:
    """Put a found vector into the library, with its covariance and today's date."""
    changes = {
        "vector_mm": tuple(round(float(value), 5) for value in pivot.vector_mm),
        "vector_covariance_mm2": tuple(
            float(f"{value:.4g}") for value in six_of(pivot)
        ),
        "date": datetime.now(tz=UTC).date(),
    }
    probes = tuple(
        probe.model_copy(update=changes) if probe.name == name else probe
        for probe in library.probes
    )
    changed = library.model_copy(update={"probes": probes})
    text = rewritten_text(changed.model_dump(by_alias=True), path.read_text("utf-8"))
    write_atomically(path, text)
    return changed


def _cone(folder: Path, campaign: Campaign, cone_name: str | None) -> int:
    cones = {a.id: i for i, a in enumerate(campaign.artefacts) if a.kind == "cone"}
    if cone_name is None and len(cones) == 1:
        return next(iter(cones.values()))
    if cone_name in cones:
        return cones[cone_name]
    known = ", ".join(cones) or "none"
    text = (
        f"has the cones {known}; name one with --cone"
        if cone_name is None
        else f"has no cone {cone_name!r}; it has: {known}"
    )
    raise FileError(folder / "campaign.toml", [Problem("artefacts", text)])
