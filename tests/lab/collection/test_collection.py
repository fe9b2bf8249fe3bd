"""The files of a collection: nothing lost, nothing twice, whatever ended it."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.lab.collection.collection import JOURNAL, CollectedTouch, Collection
from traverse.lab.collection.figures import (
    agreement,
    coverage,
    implausible_mm,
    picture,
)
from traverse.lab.collection.plan import targets_of
from traverse.strict_toml.problems import FileError

CAMPAIGN = """\
schema = "traverse/campaign/1"
poses = "poses.csv"
start_utc = 2026-11-20T09:00:00Z
[[artefacts]]
id = "bar"
kind = "ball_bar"
radius_mm = 12.7
distance_mm = 100.0
[[artefacts]]
id = "seat"
kind = "cone"
"""
MORE = """\
[[artefacts]]
id = "face"
kind = "plane"
[[artefacts]]
id = "plate"
kind = "points"
frame = "own"
points_mm = { a = [0.0, 0.0, 0.0], b = [60.0, 0.0, 0.0] }
"""
START_NS = 1_795_165_200_000_000_000
NAMES = ["J1", "J2"]


def touch(
    number: int, artefact="seat", feature="", place=(1.0, 2.0, 3.0)
) -> CollectedTouch:
    return CollectedTouch(
        id=f"s-{number}",
        session="s",
        seq=number,
        time_ns=START_NS + number * 1_000_000_000,
        artefact=artefact,
        feature=feature,
        angles_rad=[0.1 * number, -1.0 / (number + 1)],
        temperature_c=20.5,
        approach=[1, -1],
        speed_rad_s=[0.25, -0.5],
        direction=None,
        xyz_mm=list(place),
    )


def opened(folder: Path, more: str = "") -> Collection:
    (folder / "campaign.toml").write_text(CAMPAIGN + more)
    file = read_campaign_file(folder / "campaign.toml")
    collection = Collection(file, folder, NAMES, targets_of(file, 3))
    collection.resume()
    return collection


def test_targets_are_the_features_of_all_artefacts(tmp_path):
    collection = opened(tmp_path)
    assert [str(t) for t in collection.targets] == ["bar 1", "bar 2", "seat"]
    assert [t.wanted for t in collection.targets] == [3, 3, 3]


def test_the_table_is_a_campaign(tmp_path):
    collection = opened(tmp_path)
    for number, (artefact, feature) in enumerate(
        [("bar", "1"), ("bar", "2"), ("seat", "")]
    ):
        assert collection.take(touch(number, artefact, feature))
    poses = read_campaign(tmp_path, NAMES).poses
    assert poses.time_s.tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_array_equal(poses.angles_rad[2], [0.2, -1.0 / 3])
    np.testing.assert_array_equal(poses.approaches, [[1, -1]] * 3)
    np.testing.assert_array_equal(poses.speeds_rad_s, [[0.25, -0.5]] * 3)
    assert poses.temperature_c.tolist() == [20.5] * 3


@settings(max_examples=20)  # every step waits for the disk
@given(
    st.lists(st.tuples(st.integers(0, 3), st.booleans(), st.booleans()), max_size=12)
)
def test_what_is_delivered_again_or_taken_back_counts_right(tmp_path_factory, steps):
    folder = tmp_path_factory.mktemp("collection")
    collection, kept, gone = opened(folder), set(), set()
    for number, takes, restarts in steps:
        if restarts:
            collection = opened(folder)
        name = f"s-{number}"
        if takes:
            fresh = name not in kept | gone
            assert collection.take(touch(number)) == fresh
            kept |= {name} - gone
        else:
            assert collection.retract(name) == (name in kept)
            gone |= kept & {name}
            kept -= {name}
    again = opened(folder)
    assert set(again.touches) == set(collection.touches) == kept


@pytest.mark.parametrize("cut", [1, 7, 60])
def test_a_torn_last_line_is_left_out(tmp_path, cut):
    collection = opened(tmp_path)
    for number in range(3):
        collection.take(touch(number))
    journal = tmp_path / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-cut])
    again = opened(tmp_path)
    assert list(again.touches) == ["s-0", "s-1"]
    assert again.take(touch(2))  # delivered once more
    assert list(opened(tmp_path).touches) == ["s-0", "s-1", "s-2"]


def test_a_journal_of_another_campaign_is_refused_and_left_alone(tmp_path):
    opened(tmp_path).take(touch(0))
    journal = tmp_path / JOURNAL
    journal.write_text(journal.read_text().replace("seat", "stool"))
    before = journal.read_bytes()
    with pytest.raises(FileError, match="stool' is not in the campaign"):
        opened(tmp_path)
    assert journal.read_bytes() == before


def test_figures_tell_a_bad_touch(tmp_path):
    collection = opened(tmp_path)
    assert agreement(collection, "seat", "cone") == ""
    for number, x in enumerate([0.0, 0.0, 3.0]):
        collection.take(touch(number, place=(x, 0, 0)))
    assert agreement(collection, "seat", "cone").startswith("2.0000 mm at most")
    rng = np.random.default_rng(1)
    for number in range(12):
        normal = rng.normal(size=3)
        normal *= 15.7 / np.linalg.norm(normal)
        centre = [100.0 * (number % 2), 0, 0]
        feature = "12"[number % 2]
        collection.take(touch(10 + number, "bar", feature, tuple(centre + normal)))
    assert agreement(collection, "bar", "ball_bar").startswith(
        "distance 100.0000 mm (known 100)"
    )


def test_coverage_counts_sectors_of_the_reading():
    turned = [
        CollectedTouch(
            "a", "s", 0, 0, "x", "", [-0.01, 0.01], None, None, None, None, [0] * 3
        ),
        CollectedTouch(
            "b", "s", 1, 0, "x", "", [6.29, 3.2], None, None, None, None, [0] * 3
        ),
    ]
    counts = coverage(turned, 2)
    assert counts[0].nonzero()[0].tolist() == [0, 35]
    assert counts[1].nonzero()[0].tolist() == [0, 18]
    assert picture(counts[0]) == "█" + " " * 34 + "█"


CAP = 15.7 * np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8], [-1, 0, 0], [0, -1, 0]])


@pytest.mark.parametrize(
    ("where", "others_mm", "place", "off_mm"),
    [
        # One seat, whatever its features; 53 mm off, and 4 mm, as a bad arm is.
        (("seat", ""), [[1, 2, 3], [1, 2, 3.1]], [54, 2, 3.05], 53.0),
        (("seat", ""), [[1, 2, 3], [1, 2, 3.1]], [5, 2, 3.05], None),
        (("seat", ""), [], [54, 2, 3], None),
        (("plate", "a"), [[0, 0, 0]], [0, 60, 0], 60.0),
        # A ball of 12.7 mm, tip 3 mm: further apart than its poles; inside of it.
        (("bar", "1"), [[0, 0, 15.7]], [0, 0, -25.7], 10.0),
        (("bar", "1"), [[0, 0, 15.7]], [0, 0, -15.7], None),
        (("bar", "1"), CAP, [9.7, 0, 0], 6.0),
        (("bar", "1"), CAP, [0, 0, -15.7], None),
        (("face", ""), [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [900, 0, 0], None),
    ],
)
def test_a_touch_of_another_place_is_questioned(
    tmp_path, where, others_mm, place, off_mm
):
    collection = opened(tmp_path, MORE)
    for number, other in enumerate(others_mm):
        collection.take(touch(number, *where, other))
    distance_mm = implausible_mm(collection, touch(99, *where, place), 3.0)
    assert distance_mm == (None if off_mm is None else pytest.approx(off_mm, abs=1e-6))


def test_who_counts_a_far_touch_in_is_asked_no_more(tmp_path):
    """An arm before its identification: 53 mm is how coarse it is."""
    collection = opened(tmp_path)
    for number, x_mm in enumerate([0.0, 1.0, 0.5, 53.5]):
        collection.take(touch(number, place=(x_mm, 0.0, 0.0)))
    far = [touch(9, place=(x_mm, 0.0, 0.0)) for x_mm in (-60.0, 90.0, 110.0)]
    distances_mm = [implausible_mm(collection, far_touch, 3.0) for far_touch in far]
    assert distances_mm == [None, None, pytest.approx(109.25)]
