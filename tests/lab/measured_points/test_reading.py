"""Recordings as data of acceptance: one touch is the mean of its samples."""

import numpy as np
import pytest

from tests.lab.campaign.test_stream_table import (
    ARM,
    ARTEFACTS,
    HEAD,
    JOINTS,
    PER_TURN,
    TURNS,
    at,
    folder_of,
    stream,
)
from tests.recording.sample_recordings import RecordingWriter
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.measured_points.reading import files_read, read_measured
from traverse.strict_toml.problems import FileError

TOUCHING = [at(0, "seat"), at(100, None), at(200, "bar", "2"), at(300, "bar", "1")]


def means(folder, arm):
    """By the daemon's kinematics, from the poses themselves."""
    poses = read_campaign(folder, JOINTS).poses
    places = probe_centre(geometry_from_arm(arm), poses.angles_rad)
    parts = [places[poses.lines <= 100], places[(poses.lines > 200)]]
    return parts[0].mean(axis=0), parts[1][:100].mean(axis=0)


def test_a_touch_of_a_recording_is_the_mean_of_its_samples(tmp_path):
    arm = parse_arm(ARM)
    folder = folder_of(tmp_path, TOUCHING)
    measured = read_measured(folder, arm)
    seat, first = means(folder, arm)
    assert measured.of("seat").features == ("",)
    assert measured.of("bar").features == ("2", "1")
    np.testing.assert_allclose(measured.of("seat").places_mm[0], seat, atol=1e-9)
    np.testing.assert_allclose(measured.of("bar").places_mm[0], first, atol=1e-9)
    assert measured.of("bar").tip_mm.tolist() == [3.0, 3.0]


def test_of_a_scan_each_sample_is_a_point(tmp_path):
    arm = parse_arm(ARM)
    folder = folder_of(tmp_path, [at(0, "scan-seat"), *TOUCHING[1:]])
    file = folder / "campaign.toml"
    file.write_text(file.read_text().replace('"seat"', '"scan-seat"'))
    measured = read_measured(folder, arm)
    poses = read_campaign(folder, JOINTS).poses
    places = probe_centre(geometry_from_arm(arm), poses.angles_rad[poses.lines <= 100])
    np.testing.assert_allclose(measured.of("scan-seat").places_mm, places, atol=1e-9)
    assert len(places) > 90
    assert measured.of("bar").features == ("2", "1")


def test_a_recording_may_hold_its_campaign(tmp_path):
    path, arm = tmp_path / "alone.mcap", parse_arm(ARM)
    counts = (np.round(TURNS) + np.array([4000, 300])) % PER_TURN
    text = HEAD.replace("scan.mcap", "elsewhere.mcap") + ARTEFACTS
    with RecordingWriter(path, JOINTS, ARM, text) as writer:
        for value in TOUCHING:
            writer.add_touching(value)
        writer.add_samples(stream(counts))
    measured = read_measured(path, arm)
    beside = read_measured(folder_of(tmp_path, TOUCHING), arm)
    for name in ("seat", "bar"):
        np.testing.assert_allclose(
            measured.of(name).places_mm, beside.of(name).places_mm, atol=1e-9
        )
    assert files_read(path) == (path,)


def test_a_recording_without_a_campaign_is_refused(tmp_path):
    folder = folder_of(tmp_path, TOUCHING)
    with pytest.raises(FileError, match=r"holds no campaign\.toml"):
        read_measured(folder / "scan.mcap", parse_arm(ARM))


def test_files_lie_beside_one_another(tmp_path):
    folder = folder_of(tmp_path, TOUCHING)
    assert [path.name for path in files_read(folder)] == ["campaign.toml", "scan.mcap"]
    head = HEAD.replace("scan.mcap", "../scan.mcap")
    (folder / "campaign.toml").write_text(head + ARTEFACTS)
    with pytest.raises(FileError, match="put it beside"):
        files_read(folder)


def test_effects_that_could_not_be_applied_are_reported(tmp_path):
    effect = '[[effects]]\nkind = "probe_radius"\nradius_error_mm = 0.01\n'
    measured = read_measured(folder_of(tmp_path, TOUCHING), parse_arm(ARM + effect))
    assert "touches: effects of the contact left out" in measured.notes[0]
    effect = (
        '[[effects]]\nkind = "artefact_length"\nartefact = "bar"\nerror_ppm = 5.0\n'
    )
    measured = read_measured(tmp_path, parse_arm(ARM + effect))
    assert "artefact_length of the arm file is not applied" in measured.notes[0]
