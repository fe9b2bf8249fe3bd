"""Measurements of the demonstration, compared with the certificates."""

import tomllib
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from traverse.kinematics.fits import fit_sphere, spread_about_mean
from traverse.plurals import counted
from traverse.protocol.messages import Point, Scan

DATA = Path(__file__).parent / "demo_data"


@dataclass(frozen=True, slots=True)
class Expected:
    """The artefact of the next point, and its certificate."""

    kind: str
    artefact: str
    feature: str
    radius_mm: float
    distance_mm: float


def write_files(folder: Path, host: str, port: int) -> None:
    """Put arm file and both configurations of the demonstration into a folder."""
    for name in ("arm.toml", "identified.toml", "arm.cov.npz", "simulator.toml"):
        (folder / name).write_bytes((DATA / name).read_bytes())
    template = (DATA / "daemon.toml").read_text("utf-8")
    text = template.format(folder=folder, host=host, port=port)
    (folder / "daemon.toml").write_text(text, "utf-8")


def expected_points() -> list[Expected]:
    simulation = tomllib.loads((DATA / "simulator.toml").read_text("utf-8"))
    points = []
    for motion in simulation["motion"]:
        features = {"ball_bar": ["1", "2"], "sphere": [""], "cone": [""]}
        for feature in features.get(motion["kind"], []):
            expected = Expected(
                motion["kind"],
                motion["artefact"],
                feature,
                motion.get("radius_mm", 0.0),
                motion.get("distance_mm", 0.0),
            )
            points += [expected] * motion.get("points", motion.get("postures", 0))
    return points


class Round:
    """Collect points and scan blocks, and summarise them."""

    def __init__(self) -> None:
        self._expected = expected_points()
        self._points: dict[int, Point] = {}
        self._latencies_ms: list[float] = []
        self._scanned = 0
        self._next_seq = 0
        self._missing = 0
        self._first_ns = 0
        self._last_ns = 0

    @property
    def rounds(self) -> int:
        return len(self._points) // len(self._expected)

    def add_point(self, point: Point, received_ns: int) -> Expected:
        if point.seq not in self._points:
            self._points[point.seq] = point
            self._latencies_ms.append((received_ns - point.time_ns) * 1e-6)
        return self._expected[point.seq % len(self._expected)]

    def add_scan(self, scan: Scan) -> None:
        n = len(scan.dtime_ns)
        if not n:
            return
        self._missing += scan.seq - self._next_seq
        self._next_seq = scan.seq + n
        self._first_ns = self._first_ns or scan.time_ns
        self._last_ns = scan.time_ns + int(scan.dtime_ns[-1])
        self._scanned += n

    def summary(self) -> list[str]:
        rounds = counted(self.rounds, "round")
        lines = [f"measured {rounds}, {counted(len(self._points), 'point')}"]
        if self.rounds:
            lines += self._artefact_lines()
        if self._latencies_ms:
            p50, p99 = np.percentile(self._latencies_ms, [50, 99])
            lines.append(
                f"latency    trigger to this terminal p50 {p50:.2f} ms, p99 {p99:.2f} "
                "ms, of which 5 ms are the button's debouncing"
            )
        if self._scanned > 1:
            seconds = (self._last_ns - self._first_ns) * 1e-9
            rate_hz = (self._scanned + self._missing - 1) / seconds
            lines.append(
                f"scan       {rate_hz:.2f} Hz achieved, "
                f"{counted(self._scanned, 'point')}, "
                f"{self._missing} missing"
            )
        return lines

    def _artefact_lines(self) -> list[str]:
        lines = []
        last = (self.rounds - 1) * len(self._expected)
        measured = [
            (expected, self._points.get(last + number))
            for number, expected in enumerate(self._expected)
        ]
        for artefact, of_artefact in groupby(
            measured, key=lambda item: item[0].artefact
        ):
            rows = list(of_artefact)
            features: dict[str, list[Point]] = {}
            for expected, point in rows:
                if point is not None:
                    features.setdefault(expected.feature, []).append(point)
            judged = _judged(rows[0][0], list(features.values()))
            lines.append(f"{artefact:10s} {judged}")
        return lines


def _judged(certificate: Expected, features: list[list[Point]]) -> str:
    clouds = [np.array([point.xyz_mm for point in points]) for points in features]
    if certificate.kind == "cone":
        spread = spread_about_mean(clouds[0])
        return (
            f"cone, {len(clouds[0])} postures: largest distance from the mean "
            f"{spread.max_deviation_mm:.4f} mm, rms {spread.rms_mm:.4f} mm"
        )
    spheres = [fit_sphere(cloud) for cloud in clouds]
    probe_mm = features[0][0].probe_radius_mm
    if certificate.kind == "sphere":
        (sphere,) = spheres
        radius_mm = sphere.radius_mm - probe_mm
        return (
            f"sphere: radius {radius_mm:.4f} mm, certificate "
            f"{certificate.radius_mm:.4f} mm, deviation "
            f"{radius_mm - certificate.radius_mm:+.4f} mm, form rms "
            f"{sphere.rms_mm:.4f} mm"
        )
    first_mm, second_mm = (sphere.centre_mm for sphere in spheres)
    length_mm = float(np.linalg.norm(first_mm - second_mm))
    return (
        f"ball bar: length {length_mm:.4f} mm, certificate "
        f"{certificate.distance_mm:.4f} mm, deviation "
        f"{length_mm - certificate.distance_mm:+.4f} mm"
    )
