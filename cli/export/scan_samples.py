"""Samples of recorded scans as touches of a plan's features."""

from pathlib import Path

import numpy as np

from traverse.cli.export.sources import clouds_of
from traverse.client.inspection.plan import Plan
from traverse.client.inspection.scan_samples import Sample, ThinnedScan
from traverse.protocol.messages import Scan
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
            chosen.add(_scan_of(cloud), numbers or (0, np.inf))
    samples = {key: chosen.samples() for key, chosen in thinned.items()}
    for key, name in name_by_range.items():
        if not samples.get(key):
            raise ValueError(
                f"{source}: {name}: no such samples of scan {key[0]}; scans: "
                f"{', '.join(recorded) or 'none'}"
            )
    features = []
    for feature in plan.features:
        ids = [s.id for s in samples.get((feature.scan, feature.samples), ())]
        points = (*(feature.points or ()), *ids) if ids else feature.points
        features.append(feature.model_copy(update={"points": points}))
    every = [sample for each in samples.values() for sample in each]
    return plan.model_copy(update={"features": tuple(features)}), every


def _scan_of(cloud: Cloud) -> Scan:
    """Return a recorded block, its joints between those of its first and last point."""
    points, after_s = cloud.points, cloud.points["after_s"]
    n = len(points)
    if n and not cloud.ends_rad.size:
        raise ValueError(
            f"scan {cloud.scan}: an earlier version recorded it, without the ball's "
            "radius and the joints' readings; scan again"
        )
    shares = np.linspace(0.0, 1.0, n)
    if n and after_s[-1] > after_s[0]:
        shares = (after_s - after_s[0]) / (after_s[-1] - after_s[0])
    first_rad, last_rad = cloud.ends_rad
    covariance_mm2 = columns_of(points, COVARIANCES)
    is_known = not np.isnan(covariance_mm2).any()  # all of a block, or none
    return Scan(
        session=cloud.session,
        scan=cloud.scan,
        seq=int(points["number"][0]) if n else 0,
        arm=cloud.arm,
        model=cloud.model,
        mode=cloud.mode,
        rate_hz=None,
        probe_radius_mm=cloud.probe_radius_mm,
        time_ns=cloud.time_ns,
        dtime_ns=np.rint(after_s * 1e9).astype(np.int64),
        xyz_mm=columns_of(points, ("x_mm", "y_mm", "z_mm")),
        ijk=columns_of(points, "ijk"),
        angles_rad=np.outer(1.0 - shares, first_rad) + np.outer(shares, last_rad),
        counts=None,
        part_xyz_mm=None,
        covariance_mm2=covariance_mm2 if is_known else None,
        quality=points["quality"],
        dropped=0,
        lost=0,
        last=False,
        total=None,
        in_doubt=0,
    )
