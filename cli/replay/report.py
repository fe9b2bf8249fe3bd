"""Report of a replay, as text and as JSON."""

import json
from collections.abc import Mapping

from traverse.daemon.replay.compare import ReplayResult, Tally
from traverse.plurals import counted


def report_of(about: Mapping[str, str], result: ReplayResult) -> str:
    """All figures as one JSON object."""
    points, scans = result.points, result.scans
    table = {
        "schema": "traverse/replay/1",
        "about": dict(about),
        "holds": result.holds,
        "kernel": {"then": result.kernel_then, "now": result.kernel_now},
        "points": _table(points.sure),
        "early_points": _table(points.early),
        "scan_points": _table(scans.tally),
        "missing": {
            "points": points.missing,
            "scan_points": scans.missing,
        },
        "new_points": points.new,
        "not_kept": points.not_kept,
        "excused": points.excused,
        "left_out_scan_points": scans.left_out,
        "samples": result.samples,
        "gaps": result.gaps,
        "tolerance_mm": points.tolerance_mm,
        "tear": result.tear,
    }
    return json.dumps(table, indent=2)


def report_text(about: Mapping[str, str], result: ReplayResult) -> str:
    """A few lines."""
    points, scans = result.points, result.scans
    is_same = result.kernel_then == result.kernel_now
    kernel = result.kernel_now
    if not is_same:
        kernel = (
            f"{kernel} (recorded with {result.kernel_then}; "
            f"TRAVERSE_KERNEL={result.kernel_then} takes that one)"
        )
    lines = [
        f"arm {about.get('arm')}, {counted(result.samples, 'sample')}, kernel {kernel}",
        *_lines("points", points.sure, result, is_same=is_same),
        *_lines("points of scans", scans.tally, result, is_same=is_same),
    ]
    early, told = points.early, []
    if early.n:
        lines.append(
            f"first seconds of a recording that began in the middle, not judged: "
            f"{early.same} of {counted(early.n, 'point')} the same"
        )
    if points.excused:
        lines.append(
            f"{counted(points.excused, 'interpolated point')}: another covariance, as "
            "blocks are cut otherwise"
        )
    if scans.left_out:
        said = counted(scans.left_out, "point")
        lines.append(f"{said} of scans begun before: not compared")
    if points.missing or scans.missing:
        told.append(
            f"missing: {counted(points.missing, 'point')}, "
            f"{counted(scans.missing, 'point')} of scans"
        )
    if points.new:
        told.append(
            f"{counted(points.new, 'point')} more than published ({points.not_kept} "
            "could not be kept then)"
        )
    if result.gaps:
        told.append(f"{counted(result.gaps, 'gap')}: the disk did not keep up then")
    if result.tear is not None:
        told.append(f"the file is {result.tear}")
    verdict = "the same" if is_same else "within the tolerance"
    lines += [*told, verdict if result.holds else f"NOT {verdict}"]
    return "\n".join(lines)


def _lines(
    what: str, tally: Tally, result: ReplayResult, *, is_same: bool
) -> list[str]:
    if not tally.n:
        return [f"no {what} to compare"]
    lines = [
        f"{tally.same} of {tally.n} {what} the same to the last bit, greatest "
        f"difference {tally.largest_mm:.3g} mm"
    ]
    if not is_same:
        lines.append(
            f"{tally.within} of {tally.n} within 4 ulp of the reach, "
            f"{result.points.tolerance_mm:.3g} mm"
        )
    if tally.differing and is_same:
        fields = ", ".join(f"{name} {n}" for name, n in tally.differing.most_common())
        lines.append(f"differing: {fields}")
    return lines


def _table(tally: Tally) -> dict[str, object]:
    return {
        "compared": tally.n,
        "same": tally.same,
        "within": tally.within,
        "largest_mm": tally.largest_mm,
        "differing": dict(tally.differing),
    }
