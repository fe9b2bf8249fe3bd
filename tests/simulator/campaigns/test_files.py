import csv
import json
import tomllib
from datetime import UTC, datetime

import numpy as np
import pytest

from tests.simulator.campaigns.arms import ball_centres_mm, seven_joint_arm
from traverse.kinematics.arm_file.arm import read_arm
from traverse.simulator.campaigns import (
    BallBar,
    CampaignSpec,
    ConditionTable,
    Cone,
    NoiseTable,
    ParallelPlanes,
    Plane,
    Points,
    Seats,
    Sphere,
    simulate_campaign,
    true_arm_file,
    write_campaign,
)

ARM = seven_joint_arm()
JOINTS = [f"J{k}" for k in range(1, 8)]
ARTEFACTS = (
    Cone(id="cone-1", n_poses=8),
    BallBar(id="bar", n_poses=8, radius_mm=12.7, distance_mm=300.0),
    BallBar(
        id="uneven",
        n_poses=8,
        radius_mm=12.7,
        second_radius_mm=10.0,
        distance_mm=300.0,
        distance_std_mm=0.001,
        expansion_per_c=1.15e-5,
    ),
    Sphere(id="ball", n_poses=8, radius_mm=20.0),
    Sphere(id="bowl", n_poses=8, radius_mm=20.0, known=True, side="inside"),
    Plane(id="plate", n_poses=8, size_mm=100.0),
    ParallelPlanes(id="gap", n_poses=8, distance_mm=90.0, size_mm=50.0, side="inside"),
    Seats(id="seats", n_poses=8, n_seats=3, distance_mm=90.0, distance_std_mm=0.01),
    Points(id="grid", n_poses=8, n_points=4, size_mm=90.0, points_std_mm=0.01),
)
SPEC = CampaignSpec(
    artefacts=ARTEFACTS,
    noise=NoiseTable(blunder_share=0.1, blunder_kinds=("contact", "encoder", "label")),
    conditions=ConditionTable(
        swing_c=1.0, speed_rad_s=0.1, start_utc=datetime(2026, 11, 20, 9, tzinfo=UTC)
    ),
)


@pytest.fixture(scope="module")
def simulated():
    return simulate_campaign(ARM, SPEC, 7)


@pytest.fixture(scope="module")
def written(simulated, tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder, simulated, ARM)
    return folder


def read_rows(folder):
    with (folder / "poses.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_header_has_the_contract_s_columns(written):
    header = (written / "poses.csv").read_text().splitlines()[0].split(",")
    assert header == [
        "time_s",
        "artefact",
        "feature",
        *(f"{j}_rad" for j in JOINTS),
        "temperature_c",
        *(f"{j}_approach" for j in JOINTS),
        *(f"{j}_speed_rad_s" for j in JOINTS),
        *("direction_x", "direction_y", "direction_z"),
        "force_n",
    ]


def test_rows_read_back_bit_for_bit(simulated, written):
    rows, campaign = read_rows(written), simulated.campaign
    assert len(rows) == campaign.n_poses == 72

    def column(name):
        return [float(row[name]) for row in rows]

    assert column("time_s") == campaign.time_s.tolist()
    assert [row["artefact"] for row in rows] == campaign.artefact.tolist()
    assert [row["feature"] for row in rows] == campaign.feature.tolist()
    assert column("temperature_c") == campaign.temperature_c.tolist()
    assert column("force_n") == campaign.force_n.tolist()
    for k, joint in enumerate(JOINTS):
        assert column(f"{joint}_rad") == campaign.readings_rad[:, k].tolist()
        assert column(f"{joint}_speed_rad_s") == campaign.speed_rad_s[:, k].tolist()
        assert column(f"{joint}_approach") == campaign.approach[:, k].tolist()
    for k, axis in enumerate("xyz"):
        cells = [row[f"direction_{axis}"] for row in rows]
        back = np.array([float(cell) if cell else np.nan for cell in cells])
        np.testing.assert_array_equal(back, campaign.direction[:, k])
        assert "nan" not in cells


def test_the_campaign_file_says_what_the_value_says(simulated, written):
    table = tomllib.loads((written / "campaign.toml").read_text())
    campaign = simulated.campaign
    assert table["schema"] == "traverse/campaign/1"
    assert table["poses"] == "poses.csv"
    assert table["start_utc"] == datetime(2026, 11, 20, 9, tzinfo=UTC)
    assert table["noise"] == {
        "encoder_rad": campaign.encoder_rad,
        "contact_mm": campaign.contact_mm,
    }
    assert table["artefacts"] == [
        {"id": stated.id, "kind": stated.kind, **stated.table}
        for stated in campaign.artefacts
    ]


def test_artefacts_have_the_contract_s_keys(written):
    table = tomllib.loads((written / "campaign.toml").read_text())
    keys = {entry["id"]: set(entry) - {"id", "kind"} for entry in table["artefacts"]}
    assert keys == {
        "cone-1": set(),
        "bar": {"radius_mm", "distance_mm"},
        "uneven": {"radius_mm", "distance_mm", "distance_std_mm", "expansion_per_c"},
        "ball": set(),
        "bowl": {"radius_mm", "side"},
        "plate": set(),
        "gap": {"distance_mm", "side"},
        "seats": {"distances"},
        "grid": {"frame", "points_std_mm", "points_mm"},
    }
    by_id = {entry["id"]: entry for entry in table["artefacts"]}
    assert by_id["bar"]["radius_mm"] == 12.7
    assert by_id["uneven"]["radius_mm"] == [12.7, 10.0]
    assert [distance["between"] for distance in by_id["seats"]["distances"]] == [
        ["1", "2"],
        ["1", "3"],
    ]
    assert list(by_id["grid"]["points_mm"]) == ["P1", "P2", "P3", "P4"]


def test_many_points_get_a_file_of_their_own(tmp_path):
    grid = Points(id="grid", n_poses=150, n_points=150, size_mm=90.0)
    simulated = simulate_campaign(ARM, CampaignSpec(artefacts=(grid,)), 1)
    write_campaign(tmp_path, simulated, ARM)
    (entry,) = tomllib.loads((tmp_path / "campaign.toml").read_text())["artefacts"]
    assert entry["points_mm"] == "grid.csv"
    with (tmp_path / "grid.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["feature", "x_mm", "y_mm", "z_mm"]
    by_feature = {r["feature"]: [float(r[f"{a}_mm"]) for a in "xyz"] for r in rows}
    assert by_feature == simulated.campaign.artefacts[0].table["points_mm"]


def test_columns_that_are_not_requested_are_not_written(tmp_path):
    spec = CampaignSpec(
        mix="cones", n_poses=10, conditions=ConditionTable(columns=("temperature",))
    )
    write_campaign(tmp_path, simulate_campaign(ARM, spec, 1), ARM)
    assert list(read_rows(tmp_path)[0])[3:] == [
        *(f"{j}_rad" for j in JOINTS),
        "temperature_c",
    ]


def test_the_truth_lies_beside(simulated, written):
    truth = simulated.truth
    table = json.loads((written / "truth" / "truth.json").read_text())
    assert [entry["id"] for entry in table["artefacts"]] == [a.id for a in ARTEFACTS]
    lines = (written / "poses.csv").read_text().splitlines()
    assert len(table["blunders"]) == len(truth.blunders) == 7
    for written_blunder, blunder in zip(table["blunders"], truth.blunders, strict=True):
        cells = lines[written_blunder["line"] - 1].split(",")
        assert float(cells[0]) == simulated.campaign.time_s[blunder.row]
        assert written_blunder["kind"] == blunder.kind
    with np.load(written / "truth" / "noise.npz") as noise:
        np.testing.assert_array_equal(noise["turns_rad"], truth.turns_rad)
        np.testing.assert_array_equal(
            noise["encoder_noise_rad"], truth.encoder_noise_rad
        )
        np.testing.assert_array_equal(noise["contact_noise_mm"], truth.contact_noise_mm)


def test_the_true_arm_reads_back_as_it_is(simulated, written):
    assert read_arm(written / "arm.toml") == ARM
    true = read_arm(written / "truth" / "arm.toml")
    assert true == true_arm_file(ARM, simulated.truth.arm)
    readings_rad = simulated.campaign.readings_rad[:5]
    np.testing.assert_allclose(
        ball_centres_mm(true, readings_rad),
        simulated.truth.centres_mm(readings_rad),
        atol=1e-9,
    )
