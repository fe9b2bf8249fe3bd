"""Samples of recorded scans as touches of a plan's features."""

from pathlib import Path

import numpy as np

from traverse.cli.export.sources import clouds_of
from traverse.client.inspection.plan import Plan
from traverse.client.inspection.scan_samples import Sample, SampleBlock, ThinnedScan
from traverse.recording.views import COVARIANCES, Cloud, columns_of


def with_samples(
    plan: Plan, source: Path, session: str | None
) -> tuple[Plan, list[Sample]]:
    """Return a plan with ids of samples in place of scans, and these samples.

    Raises:
        ValueError: the source has no such scan, or several sessions have it.
    """
    name_by_range = {
        (f.scan, f.samples): f.name for f in plan.features if f.scan is not None
    }
    if not name_by_range:
        return plan, []
    if source.suffix != ".mcap":
        raise ValueError(f"{source}: only a recording (.mcap) has scans")
    thinned: dict[object, ThinnedScan] = {}
    recorded: dict[str, None] = {}
    for cloud in clouds_of(source):
        recorded[cloud.scan] = None
        for scan, numbers in name_by_range:
            if cloud.scan != scan or session not in (None, cloud.session):
                continue
            chosen = ThinnedScan(cloud.session, scan)
            chosen = thinned.setdefault((scan, numbers), chosen)
            if chosen.part.session != cloud.session:
                raise ValueError(
                    f"{source}: several sessions have a scan {scan}, {cloud.session} "
                    f"and {chosen.part.session}; choose one with --session"
                )
            chosen.add(_block_of(cloud, numbers))
    samples = {key: chosen.samples() for key, chosen in thinned.items()}
    for key, name in name_by_range.items():
        if not samples.get(key):
            raise ValueError(
                f"{source}: {name}: no such samples of scan {key[0]}; scans: "
                f"{', '.join(recorded) or 'none'}"
            )
    ids = {key: [sample.id for sample in each] for key, each in samples.items()}
    features = tuple(
        feature
        if feature.scan is None
        else feature.model_copy(
            update={
                "points": (
                    *(feature.points or ()),
                    *ids[feature.scan, feature.samples],
                )
            }
        )
        for feature in plan.features
    )
    return plan.model_copy(update={"features": features}), [
        sample for each in samples.values() for sample in each
    ]


def _block_of(cloud: Cloud, numbers: tuple[int, int] | None) -> SampleBlock:
    """Return samples of a block, their joints between those of its first and last."""
    points, after_s = cloud.points, cloud.points["after_s"]
    if len(points) and not cloud.ends_rad.size:
        raise ValueError(
            f"scan {cloud.scan}: an earlier version recorded it, without the ball's "
            "radius and the joints' readings; scan again"
        )
    shares = np.linspace(0.0, 1.0, len(points))
    if len(points) and after_s[-1] > after_s[0]:
        shares = (after_s - after_s[0]) / (after_s[-1] - after_s[0])
    angles_rad = np.zeros((0, 0))
    if len(points):
        angles_rad = np.outer(1.0 - shares, cloud.ends_rad[0])
        angles_rad += np.outer(shares, cloud.ends_rad[1])
    seq = points["number"].astype(np.int64)
    first, last = numbers or (0, np.inf)
    rows = (seq >= first) & (seq <= last)
    time_ns = cloud.time_ns + np.rint(after_s * 1e9).astype(np.int64)
    return SampleBlock(
        cloud.session,
        cloud.scan,
        cloud.arm,
        cloud.model,
        cloud.probe_radius_mm,
        seq[rows],
        time_ns[rows],
        columns_of(points, ("x_mm", "y_mm", "z_mm"))[rows],
        columns_of(points, "ijk")[rows],
        angles_rad[rows],
        None,
        columns_of(points, COVARIANCES)[rows],
        points["quality"][rows],
    )
