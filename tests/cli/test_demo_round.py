import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.protocol import message_examples as examples
from traverse.cli.demo_round import Expected, Round, expected_points, write_files
from traverse.kinematics.arm_file.arm import read_arm
from traverse.protocol.messages import Point, Scan

PROBE_MM = 3.0


def point(seq: int, xyz_mm: np.ndarray) -> Point:
    """A point somewhere, taken with a ball of 3 mm."""
    fields = {
        **dict(examples.POINT),
        "seq": seq,
        "id": f"p-{seq}",
        "xyz_mm": tuple(xyz_mm.tolist()),
        "probe_radius_mm": PROBE_MM,
    }
    fields.pop("schema_")
    return Point(**fields)


def measured_centre_mm(expected: Expected, rng: np.random.Generator) -> np.ndarray:
    """Where a perfect arm has its ball; the bar is 0.25 mm too long, along y."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if expected.kind == "cone":
        return np.array([600.0, -150.0, 60.0])
    centre_mm = np.array([700.0, 0.0, 120.0])
    if expected.kind == "ball_bar":
        centre_mm[1] += {"1": -400.25, "2": 400.0}[expected.feature]
    return centre_mm + (expected.radius_mm + PROBE_MM) * direction


def test_a_round_is_as_long_as_the_simulators_script_says() -> None:
    expected = expected_points()
    kinds = [(e.artefact, e.feature) for e in expected]
    on_balls = [("bar", "1")] * 8 + [("bar", "2")] * 8 + [("ball", "")] * 8
    assert kinds == on_balls + [("seat", "")] * 12
    assert expected[0].distance_mm == 800.0
    assert expected[0].radius_mm == 25.4  # one inch
    assert expected[16].radius_mm == 50.8  # two inches


def test_a_perfect_arm_on_a_long_bar_shows_the_bars_deviation() -> None:
    rng = np.random.default_rng(5)
    measured = Round()
    for seq, expected in enumerate(expected_points()):
        assert measured.rounds == 0
        touch = point(seq, measured_centre_mm(expected, rng))
        answer = measured.add_point(touch, touch.time_ns + 7_000_000)
        assert answer == expected
        measured.add_point(touch, touch.time_ns + 9_000_000)  # delivered again
    assert measured.rounds == 1
    text = "\n".join(measured.summary())
    assert "measured 1 round, 36 points" in text
    assert "length 800.2500 mm, certificate 800.0000 mm, deviation +0.2500 mm" in text
    assert "radius 50.8000 mm, certificate 50.8000 mm, deviation " in text
    assert "form rms 0.0000 mm" in text
    assert "largest distance from the mean 0.0000 mm" in text
    assert "p50 7.00 ms, p99 7.00 ms" in text


def test_a_scan_with_a_gap_tells_its_rate_and_what_is_missing() -> None:
    def block(seq: int, n: int) -> Scan:
        fields = {
            **dict(examples.SCAN),
            "seq": seq,
            "time_ns": 10**18 + seq * 2_000_000,
            "dtime_ns": np.arange(n) * 2_000_000,
            "xyz_mm": np.zeros((n, 3)),
            "ijk": np.zeros((n, 3)),
            "angles_rad": np.zeros((n, 2)),
            "counts": None,
            "part_xyz_mm": None,
            "covariance_mm2": None,
            "quality": np.zeros(n, np.uint32),
            "last": False,
            "total": None,
        }
        fields.pop("schema_")
        return Scan(**fields)

    measured = Round()
    for seq, n in ((0, 100), (100, 50), (150, 0), (160, 90)):
        measured.add_scan(block(seq, n))
    (_, line) = measured.summary()
    assert line == "scan       500.00 Hz achieved, 240 points, 10 missing"


def test_nothing_measured_is_told_too() -> None:
    assert Round().summary() == ["measured 0 rounds, 0 points"]


@pytest.mark.parametrize(("host", "port"), [("127.0.0.1", 1883), ("::1", 65535)])
def test_files_of_a_demonstration_name_its_folder_and_broker(
    tmp_path: Path, host: str, port: int
) -> None:
    write_files(tmp_path, host, port)
    arm = read_arm(tmp_path / "arm.toml")
    shank = np.array(arm.probe.vector_mm) / np.linalg.norm(arm.probe.vector_mm)
    assert arm.probe.direction == pytest.approx(shank, abs=1e-15)
    daemon = tomllib.loads((tmp_path / "daemon.toml").read_text("utf-8"))
    assert daemon["broker"] == {"host": host, "port": port}
    assert daemon["device"][0]["port"] == str(tmp_path / "board.pty")
