"""The printed gauge: a closed body of the right volume, and its campaign."""

import json
import math
import struct
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from tests.running import invoke
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.artefacts.socket_gauge import SocketGauge, rounding_rad
from traverse.simulator.campaigns import (
    CampaignSpec,
    draw_noise,
    make_poses,
    write_campaign,
)

ARM = Path(__file__).parents[3] / "cli/demo_data/arm.toml"


def facets_of(stl):
    """Normal and corners of each facet, by the format's description alone."""
    (n,) = struct.unpack_from("<I", stl, 80)
    assert len(stl) == 84 + 50 * n
    numbers = [struct.unpack_from("<12f", stl, 84 + 50 * k) for k in range(n)]
    return [(row[:3], (row[3:6], row[6:9], row[9:])) for row in numbers]


def cross(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    ("distance_mm", "ball_mm", "clearance_mm"),
    [(50.0, 6.0, 0.5), (300.0, 12.7, 0.0), (14.5, 6.0, 1.0), (7.5, 1.0, 0.0)],
)
def test_the_gauge_is_a_closed_body_of_the_right_volume(
    distance_mm, ball_mm, clearance_mm
):
    facets = facets_of(SocketGauge(distance_mm, ball_mm, clearance_mm).stl())
    edges = Counter(
        (corners[k], corners[(k + 1) % 3]) for _, corners in facets for k in range(3)
    )
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    vertices = {corner for _, corners in facets for corner in corners}
    # Euler: one body without handles has 2, and both sockets have floors.
    assert len(vertices) - len(edges) // 2 + len(facets) == 2
    r = ball_mm / 2
    rim, depth = math.sqrt(2) * r, r + clearance_mm
    floor = rim - depth
    width, height = 2 * (rim + 3.0), depth + 3.0
    round_ = 96 * math.tan(math.pi / 96)  # instead of pi, around a circle
    socket = round_ * depth / 3 * (rim**2 + rim * floor + floor**2)
    expected = (distance_mm + width) * width * height - 2 * socket
    volume = sum(dot(a, cross(b, c)) for _, (a, b, c) in facets) / 6
    assert volume == pytest.approx(expected, rel=1e-5)
    for normal, (a, b, c) in facets:
        ab, ac = ([y - x for x, y in zip(a, o, strict=True)] for o in (b, c))
        across = cross(ab, ac)
        assert dot(normal, across) == pytest.approx(math.hypot(*across), rel=1e-3)


def test_a_ball_in_a_socket_touches_its_walls_and_nothing_else():
    facets = facets_of(SocketGauge(50.0, 6.0, 0.5).stl())
    centre = (25.0, 0.0, 0.0)
    walls = [(n, c) for n, c in facets if 0.5 < n[2] < 0.9]
    assert len(walls) == 2 * 2 * 96
    gaps = [
        dot(normal, [x - y for x, y in zip(centre, corners[0], strict=True)]) - 3.0
        for normal, corners in walls
        if corners[0][0] > 0
    ]
    assert max(map(abs, gaps)) < 1e-2 * 3.0
    floors = [c for n, c in facets if n[2] > 0.9 and c[0][2] < -1.0]
    assert {corner[2] for c in floors for corner in c} == {-3.5}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--distance-mm 10", "too short"),
        ("--clearance-mm 2", "expected 0 to 1.04 mm"),
        ("--distance-mm nan", "at most 1000"),
        ("--clearance-mm nan", "clearance"),
        ("--distance-std-mm 0", "above 0 mm"),
        ("--distance-std-mm nan", "at most 100"),
    ],
)
def test_what_cannot_be_printed_is_refused(tmp_path, words, message):
    out = tmp_path / "gauge"
    ran = invoke("artefact", "--out", out, *words.split(), status=2)
    assert message in ran.stderr
    assert not out.exists()


@pytest.mark.slow
def test_its_campaign_is_checked_and_identified_with(tmp_path):
    arm = read_arm(ARM)
    poses = make_poses(arm, CampaignSpec(mix="seats", n_poses=80), seed=3)
    simulated = tmp_path / "simulated"
    write_campaign(simulated, draw_noise(poses, 5), arm)
    toml = tomllib.loads((simulated / "campaign.toml").read_text("utf-8"))
    distance_mm = toml["artefacts"][0]["distance_mm"]
    folder = tmp_path / "printed"
    words = f"artefact --out {folder} --distance-mm {distance_mm} "
    words += "--distance-std-mm 0.0005 --places 4"
    invoke(*words.split())
    again = invoke(*words.split(), status=2)
    assert "exists" in again.stderr
    table = (simulated / "poses.csv").read_text("utf-8").replace("bar-", "gauge-")
    (folder / "poses.csv").write_text(table, "utf-8")
    invoke("check", folder)
    out = tmp_path / "identified"
    words = f"identify {folder} --arm {ARM} --out {out}"
    invoke(*words.split())
    report = json.loads((out / "identification.json").read_text("utf-8"))
    assert report["converged"]
    assert set(report["artefacts"]) == {f"gauge-{k}" for k in range(1, 5)}


def test_its_campaign_states_the_noise_of_counts_and_sockets():
    # 4096 counts: 1.534e-3 rad each, over sqrt(12); the coarsest encoder counts.
    assert rounding_rad([4096, 16384]) == pytest.approx(4.428e-4, rel=1e-3)
    assert rounding_rad([]) is None
    text = SocketGauge(50.0, 6.0, 0.5).campaign(2, 0.05, rounding_rad([4096]))
    noise = tomllib.loads(text)["noise"]
    assert noise == {"contact_mm": 0.035, "encoder_rad": 0.000443}
    without = tomllib.loads(SocketGauge(50.0, 6.0, 0.5).campaign(2, 0.05))
    assert without["noise"] == {"contact_mm": 0.035}
