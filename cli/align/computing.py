"""The computation of `traverse align`: from files to an alignment's values."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from traverse.cli.align.options import AlignmentOptions
from traverse.cli.export.sources import points_of
from traverse.client.exports.point_table import standing
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.files import (
    alignment_values,
    chained_values,
    read_alignment,
)
from traverse.lab.alignment.nominal import (
    Nominal,
    VolumeFunction,
    box_around,
    fixed_volume,
    read_nominal,
    volume_from_text,
)
from traverse.lab.alignment.plane_line_point import align_plane_line_point
from traverse.lab.alignment.result import AlignmentResult
from traverse.lab.alignment.touches import (
    Place,
    Touch,
    common_points,
    names_of,
    places_by_name,
    places_mm,
    read_touch_table,
    touches_of_points,
)
from traverse.lab.measured_points.reading import files_read, read_measured
from traverse.lab.measured_points.touch_errors import shared_by_points
from traverse.lab.report.provenance import (
    ReportSource,
    digest_of_files,
    report_provenance,
)
from traverse.strict_toml.problems import FileError
from traverse.tables.dialect import SUFFIXES


def compute_alignment(
    points: Path, nominal_file: Path, options: AlignmentOptions
) -> dict[str, Any]:
    """Read everything, compute everything; return the values of alignment.json.

    Raises:
        FileError: A file was refused.
        HelmertError: The points do not determine the alignment.
        ValueError: Something else cannot be used.
        OSError: A file cannot be read.
    """
    arm = None if options.arm is None else read_arm(options.arm)
    touches, remarks = _touches(points, options, arm)
    arm_name = _arm_of(touches) or (None if arm is None else arm.name)
    name = options.name or nominal_file.stem
    if options.method == "leapfrog":
        result = _leapfrog(options, touches, nominal_file, arm, remarks)
    else:
        nominal = read_nominal(nominal_file)
        name = options.name or nominal.name or nominal_file.stem
        result = _onto_nominal(options, touches, nominal, arm, remarks)
    values = alignment_values(
        result,
        name=name,
        arm=arm_name,
        measured=str(points),
        nominal=str(nominal_file),
        provenance=report_provenance(_source(points), options.operator),
    )
    if options.onto is None:
        return values
    return chained_values(values, read_alignment(options.onto), str(options.onto))


def _source(points: Path) -> ReportSource:
    files = files_read(points) if points.is_dir() else (points,)
    return ReportSource(points.resolve().name, digest_of_files(files))


def _onto_nominal(
    options: AlignmentOptions,
    touches: Sequence[Touch],
    nominal: Nominal,
    arm: Arm | None,
    remarks: Sequence[str],
) -> AlignmentResult:
    volume_of, source = _volume(options, nominal, arm)
    if options.method == "3-2-1":
        aligned = align_plane_line_point(
            touches, nominal, volume_of, source, std_mm=options.std
        )
        return replace(aligned, remarks=(*remarks, *aligned.remarks))
    known = [point.name for point in nominal.points]
    measured, left_out = places_by_name(
        touches, known, std_mm=options.std, spheres=options.spheres
    )
    places = {
        point.name: Place(place, point.std_mm**2 * np.eye(3))
        for point, place in zip(nominal.points, nominal.places_mm(), strict=True)
    }
    return best_fit_alignment(
        common_points(measured, places),
        volume_of,
        source,
        with_scale=options.scale,
        radii_mm=_radii_mm(options, touches, known),
        remarks=[*remarks, *left_out],
    )


def _radii_mm(
    options: AlignmentOptions, touches: Sequence[Touch], names: Collection[str]
) -> set[float]:
    """Return the radii of balls whose centres are aligned; of spheres none matter."""
    if options.spheres:
        return set()
    return {
        touch.off_mm
        for touch in touches
        if touch.off_mm is not None and not {*touch.names}.isdisjoint(names)
    }


def _leapfrog(
    options: AlignmentOptions,
    touches: Sequence[Touch],
    from_file: Path,
    arm: Arm | None,
    remarks: Sequence[str],
) -> AlignmentResult:
    before, first_remarks = _touches(from_file, options, arm)
    first, left_out = places_by_name(
        before, None, std_mm=options.std, spheres=options.spheres
    )
    first_remarks += left_out
    second, left_out = places_by_name(
        touches, list(first), std_mm=options.std, spheres=options.spheres
    )
    if options.volume is None:
        volume_of = fixed_volume(box_around(places_mm(before)))
        source = "around all that the first station touched"
    else:
        volume_of, source = volume_from_text(options.volume, arm), "--volume"
    return best_fit_alignment(
        common_points(second, first),
        volume_of,
        source,
        method="leapfrog",
        with_scale=options.scale,
        radii_mm=_radii_mm(options, [*before, *touches], second),
        remarks=[
            *remarks,
            *left_out,
            *(f"first station: {remark}" for remark in first_remarks),
        ],
    )


def _volume(
    options: AlignmentOptions, nominal: Nominal, arm: Arm | None
) -> tuple[VolumeFunction, str]:
    if options.volume is not None:
        return volume_from_text(options.volume, arm), "--volume"
    if nominal.volume is not None:
        return fixed_volume(nominal.volume.volume()), "of the nominal file"
    around_mm = nominal.places_mm()
    if not len(around_mm) or not np.any(np.ptp(around_mm, axis=0)):
        raise ValueError(
            "the volume in which the alignment is used is not known; give --volume, "
            "or [volume] in the nominal file"
        )
    return fixed_volume(box_around(around_mm)), "around all nominal points"


def _touches(
    source: Path, options: AlignmentOptions, arm: Arm | None
) -> tuple[list[Touch], list[str]]:
    """Read touches with names, of the ball's centre or of the touched place.

    The source is points in JSON lines, a recording, an outbox, a table in CSV, or the
    folder of a campaign that was measured with an arm.

    Returns:
        The touches, and remarks on their common errors.

    Raises:
        FileError: A file was refused.
        ValueError: It is nothing of this, or a point lacks something.
        OSError: It cannot be read.
    """
    if source.is_dir():
        return _of_campaign(source, options, arm)
    if source.suffix.lower() in SUFFIXES:  # Excel's Unicode text is .txt
        return read_touch_table(source, options.coordinates), []
    points = standing(list(points_of(source)))
    if not points:
        raise FileError(source, "holds no points; measure some")
    shared_mm, remarks = None, []
    if options.std is None and all(p.covariance_mm2 is not None for p in points):
        try:
            if options.arm is None or arm is None:
                raise ValueError("the arm file is not given: --arm FILE")
            shared_mm = shared_by_points(points, options.arm, arm)
            remarks.append(_SHARED)
        except ValueError as error:
            remarks.append(f"{_APART}: {error}")
    return touches_of_points(points, options.coordinates, shared_mm), remarks


_SHARED = "errors of the arm's parameters are taken as what they are: common to all"
_APART = "errors of the arm's parameters are taken as each point's own"


def _of_campaign(
    folder: Path, options: AlignmentOptions, arm: Arm | None
) -> tuple[list[Touch], list[str]]:
    if options.arm is None or arm is None:
        raise ValueError(f"{folder}: a campaign needs the arm file: --arm FILE")
    if options.coordinates != "centre":
        raise ValueError(f"{folder}: a campaign has centres of the ball only")
    measured = read_measured(folder, arm, options.arm)
    remarks = []
    if options.std is None:
        lacking = measured.errors_unknown
        remarks.append(_SHARED if lacking is None else f"no errors stated: {lacking}")
    touches = []
    for name, touched in measured.touched.items():
        errors = touched.errors
        for row, feature in enumerate(touched.features):
            touches.append(
                Touch(
                    names_of(name, feature),
                    touched.places_mm[row],
                    None if errors is None else errors.covariances_mm2[row],
                    None if errors is None else errors.shared_mm[row],
                    arm=arm.name,
                    off_mm=float(touched.tip_mm[row]),
                )
            )
    return touches, remarks


def _arm_of(touches: Sequence[Touch]) -> str | None:
    """The arm that took them; None if unknown.

    Raises:
        ValueError: Several arms did.
    """
    arms = sorted({touch.arm for touch in touches if touch.arm is not None})
    if len(arms) > 1:
        raise ValueError(
            f"points of several arms: {', '.join(arms)}; give those of one"
        )
    return arms[0] if arms else None
