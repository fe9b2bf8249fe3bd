from pathlib import Path

import pytest

from tests.client.display.values import doubt
from tests.lab.collection.test_collection import CAMPAIGN
from tests.protocol.message_examples import POINT
from traverse.cli.collect.session import _Session
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.lab.collection.collection import Collection
from traverse.lab.collection.plan import targets_of
from traverse.protocol.messages import Label, Quality


@pytest.fixture
def session(tmp_path: Path) -> _Session:
    file = tmp_path / "campaign.toml"
    file.write_text(CAMPAIGN, "utf-8")
    read = read_campaign_file(file)
    names = [f"J{k}" for k in range(len(POINT.angles_rad))]
    collection = Collection(read, tmp_path, names, targets_of(read, 9))
    return _Session(collection, frozenset({"empirical"}))


def take(session: _Session, seq: int, *flags: str) -> int:
    """One more point on the seat; how many count."""
    point = POINT.model_copy(
        update={
            "seq": seq,
            "id": f"{POINT.session}-{seq}",
            "label": Label(artefact="seat"),
            "quality": Quality(ok=not flags, flags=flags),
        }
    )
    session._take(point)
    return len(session._collection.touches)


def test_what_concerns_geometry_or_utc_alone_disqualifies_no_point(session):
    assert take(session, 0, "geometry_unknown") == 1
    assert take(session, 1, "utc_uncertain", "empirical") == 2
    assert session.flagged.lines() == []


def test_points_that_are_in_doubt_since_they_were_taken_are_left_out(session, capsys):
    assert take(session, 0) == 1
    assert take(session, 1) == 2
    later = doubt(points=f"{POINT.session}-1 {POINT.session}-7")
    session._doubt([later.model_copy(update={"flags": ("utc_uncertain",)})])
    assert len(session._collection.touches) == 2
    for _ in range(2):  # each status has it
        session._doubt([later])
    assert [touch.seq for touch in session._collection.touches.values()] == [0]
    said = capsys.readouterr().out
    assert said.count("point 1 is left out again: flagged stale since") == 1
    assert take(session, 7) == 1


def test_flagged_points_are_counted_with_the_reason_and_the_remedy(session, capsys):
    assert take(session, 0) == 1
    assert take(session, 1, "turns_uncertain", "geometry_unknown") == 1
    assert "left out: flagged turns_uncertain; " in capsys.readouterr().out
    assert take(session, 2, "turns_uncertain", "identity_unconfirmed") == 1
    first, *reasons = session.flagged.lines()
    assert first.startswith("2 points were left out")
    assert reasons[0].startswith("  turns_uncertain: 2 points; ")
    assert "traverse confirm" in reasons[0]
    assert reasons[1].startswith("  identity_unconfirmed: 1 point; ")
    assert len(reasons) == 2
