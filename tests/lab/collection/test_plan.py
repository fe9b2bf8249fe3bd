"""A collection that follows a plan: steps in order, counted up, shown in the volume."""

import numpy as np
import pytest

from tests.lab.collection.test_collection import CAMPAIGN, NAMES, touch
from traverse.cli.collect.view import instruction, summary
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.lab.collection.collection import Collection
from traverse.lab.collection.plan import PlanFile, planned_targets, volume_counts
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict

PLAN = """\
schema = "traverse/collection-plan/1"
reach_mm = 300.0
[[steps]]
artefact = "bar"
feature = "1"
touches = 2
say = "first ball"
[[steps]]
artefact = "bar"
feature = "2"
touches = 2
[[steps]]
artefact = "bar"
feature = "1"
touches = 2
say = "first ball again"
"""


def planned(folder, text=PLAN):
    (folder / "campaign.toml").write_text(CAMPAIGN)
    (folder / "plan.toml").write_text(text)
    file = read_campaign_file(folder / "campaign.toml")
    plan = read_strict(folder / "plan.toml", PlanFile)
    targets = planned_targets(plan, file, "plan.toml")
    collection = Collection(file, folder, NAMES, targets, plan)
    collection.resume()
    return collection


def test_steps_are_done_in_their_order_and_counted_up(tmp_path):
    collection = planned(tmp_path)
    asked = []
    for number in range(6):
        target = collection.unfinished()[0]
        asked.append((target.feature, target.wanted))
        collection.take(touch(number, "bar", target.feature))
    assert asked == [("1", 2), ("1", 2), ("2", 2), ("2", 2), ("1", 4), ("1", 4)]
    assert collection.unfinished() == []


def test_what_to_do_is_said(tmp_path):
    collection = planned(tmp_path)
    assert instruction(collection, collection.unfinished()[0]) == (
        "bar 1: first ball. 2 more."
    )
    collection.take(touch(1, "bar", "1", (100.0, 100.0, 100.0)))
    collection.take(touch(2, "bar", "1", (-10.0, -10.0, -10.0)))
    lines = summary(collection)
    assert lines[0] == "bar: feature 1: 2 of 4, feature 2: 0 of 2"
    assert lines[-3:] == [
        "touched at 0% to 33% of the reach: █·······",
        "touched at 33% to 67% of the reach: ·······█",
        "touched at 67% to 100% of the reach: ········",
    ]


def test_shells_and_octants_by_hand(tmp_path):
    plan = planned(tmp_path).plan
    places = np.array([[10.0, 1, 1], [-150, -1, -1], [1, -1, 299], [1, -1, 400]])
    counts = volume_counts(places, plan)
    # Octants: 1 for x, 2 for y, 4 for z above the middle; too far counts as far.
    assert (counts[0, 7], counts[1, 0], counts[2, 5]) == (1, 1, 2)
    assert counts.sum() == 4


def test_a_plan_goes_with_its_campaign(tmp_path):
    text = PLAN.replace('"bar"', '"bra"', 1).replace('feature = "2"', 'feature = "3"')
    with pytest.raises(FileError) as refused:
        planned(tmp_path, text)
    reported = [(problem.where, problem.message) for problem in refused.value.problems]
    assert reported[0] == (
        "steps[0].artefact",
        "unknown artefact 'bra'; did you mean 'bar'?",
    )
    assert reported[1][0] == "steps[1].feature"
