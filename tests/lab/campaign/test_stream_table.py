"""Campaigns whose poses are a recording."""

from datetime import UTC, datetime

import numpy as np
import pytest

from tests.arm_files import arm_text, joint_text
from tests.recording.sample_recordings import RecordingWriter
from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.campaign.stream_table import senses_of, speeds_of, stretches_of
from traverse.recording.values import Conditions, Samples, Touching
from traverse.strict_toml.problems import FileError

PER_TURN = 4096
JOINTS = ("J1", "J2")
ARM = arm_text(
    "two",
    joint_text("J1", [0, 0, 1.0], [0, 0, 100.0], 6.0, (PER_TURN, 1, "base/0")),
    joint_text("J2", [0, 1.0, 0], [100.0, 0, 0], -0.5, (PER_TURN, -1, "base/1")),
)
HEAD = 'schema = "traverse/campaign/1"\nposes = "scan.mcap"\n'
ARTEFACTS = """[[artefacts]]
id = "seat"
kind = "cone"
[[artefacts]]
id = "bar"
kind = "ball_bar"
radius_mm = 12.7
distance_mm = 400.0
"""
STEP_NS = 5_000_000
UTC_NS = 1_795_000_000_000_000_000
N = 400
# The second joint moves forth, rests, and returns.
TURNS = np.stack(
    [np.arange(N), np.interp(np.arange(N), [0, 150, 250, 400], [0, 900, 900, 0])],
    axis=1,
)


def stream(counts, missing=()):
    keep = np.setdiff1d(np.arange(len(counts)), missing)
    times_ns = 10**12 + STEP_NS * keep
    return Samples(
        numbers=keep,
        device_ticks=keep,
        received_ns=times_ns + 200_000,
        sample_time_ns=times_ns,
        utc_ns=UTC_NS + STEP_NS * keep,
        counts=counts[keep].astype(np.uint32),
    )


def folder_of(tmp_path, touching, *, counts=None, missing=(), head=HEAD, arm=ARM):
    (tmp_path / "campaign.toml").write_text(head + ARTEFACTS)
    if counts is None:
        counts = (np.round(TURNS) + np.array([4000, 300])) % PER_TURN
    with RecordingWriter(tmp_path / "scan.mcap", JOINTS, arm) as writer:
        for value in touching:
            writer.add_touching(value)
        writer.add_conditions(Conditions(10**12, 20.0))
        writer.add_conditions(Conditions(10**12 + 100 * STEP_NS, 21.0, 0.5))
        samples = stream(counts, missing)
        for first in range(0, len(samples), 60):
            writer.add_samples(samples.part(slice(first, first + 60)))
    return tmp_path


def at(sample, artefact, feature=""):
    return Touching(10**12 + sample * STEP_NS, artefact, feature)


def test_a_stream_becomes_poses(tmp_path):
    touching = [at(0, "seat"), at(100, None), at(200, "bar", "2"), at(300, "bar", "1")]
    campaign = read_campaign(folder_of(tmp_path, touching), JOINTS)
    poses = campaign.poses
    # Four samples at each end have no speed.
    assert poses.lines.tolist() == [*range(5, 101), *range(201, 397)]
    assert campaign.is_stream
    assert campaign.notes == ()
    assert campaign.start_utc == datetime.fromtimestamp(UTC_NS // 10**9, UTC)
    assert np.allclose(poses.time_s, 0.005 * (poses.lines - 1))
    assert [campaign.artefacts[i].id for i in poses.artefacts[[0, -1]]] == [
        "seat",
        "bar",
    ]
    names = campaign.feature_names[1]
    assert names[poses.features[96]] == "2"
    assert names[poses.features[-1]] == "1"
    # By hand: 4000 counts are 6.136 rad, nearest to 6.0 in this very turn; they
    # pass a whole turn at the 96th sample and go on. -300 counts are -0.460 rad.
    rows = poses.lines - 1
    by_count = 2.0 * np.pi / PER_TURN
    assert np.allclose(poses.angles_rad[:, 0], by_count * (4000 + rows))
    expected = -by_count * (300 + np.round(TURNS[rows, 1]))
    assert np.allclose(poses.angles_rad[:, 1], expected)
    assert np.allclose(poses.speeds_rad_s[:, 0], by_count / 0.005)
    assert np.allclose(poses.temperature_c[:5], 20.0 + rows[:5] / 100.0)
    assert np.allclose(poses.temperature_c[-5:], 21.0)
    assert np.all(poses.force_n == 0.5)
    assert poses.directions is None


def test_a_joint_at_rest_keeps_the_sense_of_its_last_motion(tmp_path):
    campaign = read_campaign(folder_of(tmp_path, [at(0, "seat")]), JOINTS)
    senses = campaign.poses.approaches[:, 1]
    rows = campaign.poses.lines - 1
    assert np.all(senses[rows < 240] == -1.0)
    assert np.all(senses[rows > 256] == 1.0)


def test_time_counts_from_the_start_of_the_campaign(tmp_path):
    head = HEAD + "start_utc = 2026-11-18T00:00:00Z\n"
    campaign = read_campaign(folder_of(tmp_path, [at(0, "seat")], head=head), JOINTS)
    start_s = datetime(2026, 11, 18, tzinfo=UTC).timestamp()
    assert campaign.poses.time_s[0] == pytest.approx(UTC_NS / 1e9 + 0.02 - start_s)
    assert campaign.start_utc == datetime(2026, 11, 18, tzinfo=UTC)


def test_gaps_divide_and_long_ones_are_noted(tmp_path):
    missing = range(50, 170)
    folder = folder_of(tmp_path, [at(0, "seat")], missing=missing)
    campaign = read_campaign(folder, JOINTS)
    rows = set((campaign.poses.time_s / 0.005).round().astype(int).tolist())
    assert rows == {*range(4, 46), *range(174, 396)}
    (note,) = campaign.notes
    assert "1 gap of more than 0.5 s, the longest 0.605 s" in note


def test_a_torn_recording_is_used_up_to_the_tear(tmp_path):
    folder = folder_of(tmp_path, [at(0, "seat")])
    recording = (folder / "scan.mcap").read_bytes()
    (folder / "scan.mcap").write_bytes(recording[:-30])
    campaign = read_campaign(folder, JOINTS)
    assert len(campaign.poses) == N - 8
    assert "torn after" in campaign.notes[0]


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        ({"touching": [at(0, "saet")]}, "saet"),
        ({"touching": [at(0, "bar", "3")]}, "feature"),
        ({"touching": []}, "names no artefact"),
        ({"touching": [at(N, "seat")]}, "nothing is touched in any sample"),
        ({"counts": np.full((N, 2), PER_TURN)}, "J1 has counts up to 4096"),
        ({"arm": ARM.replace("J2", "J3")}, "has the joints J1, J3"),
        ({"arm": ARM.replace("kind =", "knid =")}, "arm.toml probe.knid"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, spoilt, words):
    folder = folder_of(tmp_path, **{"touching": [at(0, "seat")], **spoilt})
    with pytest.raises(FileError) as caught:
        read_campaign(folder, JOINTS)
    assert words in str(caught.value)
    assert "scan.mcap" in str(caught.value)


def test_another_arm_is_refused(tmp_path):
    folder = folder_of(tmp_path, [at(0, "seat")])
    with pytest.raises(FileError, match=r"has the joints J1, J2; expected A, B"):
        read_campaign(folder, ("A", "B"))


def test_speeds_of_a_parabola_are_exact_but_at_the_ends():
    time_s = np.cumsum(np.random.default_rng(1).uniform(0.9, 1.1, 100)) * 0.001
    even_s = 0.001 * np.arange(100)
    stretches = stretches_of(even_s)
    angles = np.stack([3.0 * even_s**2, -2.0 * even_s], axis=1)
    speeds = speeds_of(even_s, angles, stretches)
    assert np.all(np.isnan(speeds[:20]))
    assert np.allclose(speeds[20:80, 0], 6.0 * even_s[20:80])
    line = speeds_of(time_s, -2.0 * time_s[:, np.newaxis], stretches)
    assert np.allclose(line[20:80], -2.0)
    assert np.all(senses_of(even_s, angles, speeds)[20:, 1] == -1.0)


def test_streams_of_a_few_samples_have_no_speeds():
    for n in range(3):
        time_s, angles = np.arange(n) * 0.01, np.zeros((n, 2))
        speeds = speeds_of(time_s, angles, stretches_of(time_s))
        assert np.all(np.isnan(speeds))
        assert np.all(senses_of(time_s, angles, speeds) == 0.0)
