import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

import traverse.cli
from tests.campaign_texts import ONE_CONE
from tests.client.display.values import event, point
from tests.protocol.message_examples import SCAN, SESSION
from tests.running import invoke
from traverse.daemon.monitoring.doubt_file import DoubtFile
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.outbox import message_of
from traverse.lab.campaign.campaign import read_campaign
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Point, Quality, QualityFlag
from traverse.recording.run_writer import Entry as Recorded
from traverse.recording.run_writer import RunHead, RunWriter
from traverse.recording.views import cloud_to_bytes, log_to_bytes, point_to_bytes

DEMO_ARM = Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml"


def export(*words: object, status: int = 0) -> Result:
    return invoke("export", *words, status=status)


def labelled(seq: int, place: float, artefact: str | None = "seat") -> Point:
    label = {"artefact": artefact, "feature": None}
    changes = {"angles_rad": [0.1 * seq] * 7, "counts": [seq] * 7, "label": label}
    return point(seq, xyz_mm=[place, 0.0, 0.0], compensation="shank", **changes)


POINTS = [labelled(seq, 10.0 * seq) for seq in range(4)]
ALL = [*POINTS, point(4, retracts="p-3")]


@pytest.fixture
def lines(tmp_path: Path) -> Path:
    path = tmp_path / "points.jsonl"
    path.write_bytes(b"".join(encode(p, "json") + b"\n" for p in ALL))
    return path


@pytest.fixture
def outbox(tmp_path: Path) -> Path:
    store = MessageDatabase(tmp_path / "outbox.db")
    store.add([message_of(p, "traverse/a/point", "msgpack", 10**18, "") for p in ALL])
    store.close()
    return tmp_path / "outbox.db"


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    with RunWriter(path, RunHead({"arm": "a", "version": "1"}, {})) as writer:
        for p in ALL:
            writer.add(Recorded("point", p.time_ns, point_to_bytes(p)))
        writer.add(Recorded("cloud", SCAN.time_ns, cloud_to_bytes(SCAN)))
    return path


@pytest.mark.parametrize("source", ["lines", "outbox", "recording"])
def test_points_that_stand_come_out_of_every_source(
    source: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(source)
    out = tmp_path / "out.csv"
    ran = export(path, "--out", out)
    assert ran.stderr == f"{out}: 3 points, 3 in doubt\n"
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [row["x_mm"] for row in rows] == ["0.0", "10.0", "20.0"]
    export(path, "--out", out, "--retracted", "--force")
    assert len(out.read_text().splitlines()) == 1 + 5


@pytest.mark.parametrize("to", ["csv", "jsonl", "npz", "parquet", "ply", "xyz"])
@pytest.mark.parametrize("kind", ["points", "scans"])
def test_what_an_event_put_in_doubt_afterwards_is_marked(
    to: str, kind: str, tmp_path: Path
) -> None:
    is_ok = Quality(ok=True, flags=())
    before = [
        point(seq, time_ns="1000000000", quality=is_ok.model_dump()) for seq in range(3)
    ]
    scan = SCAN.model_copy(update={"quality": np.zeros_like(SCAN.quality)})
    from_ns = scan.time_ns + int(scan.dtime_ns[-1])
    data = {"from_ns": str(from_ns), "until_ns": str(from_ns + 10**9)}
    doubt = event(
        "condition.channels",
        True,
        data={**data, "flags": "stale", "points": before[1].id},
    )
    path, out = tmp_path / "run.mcap", tmp_path / f"out.{to}"
    with RunWriter(path, RunHead({"arm": "a", "version": "1"}, {})) as writer:
        for p in before:
            writer.add(Recorded("point", p.time_ns, point_to_bytes(p)))
        writer.add(Recorded("cloud", scan.time_ns, cloud_to_bytes(scan)))
        writer.add(Recorded("log", doubt.last_ns, log_to_bytes(doubt)))
    ran = export(path, "--to", to, "--out", out, "--kind", kind, "--json")
    assert json.loads(ran.stdout)["in_doubt"] == 1
    if to == "npz":
        with np.load(out) as columns:
            (row,) = np.flatnonzero(columns["quality"] == QualityFlag.STALE)
            assert row == 1  # the second point, and the last sample


def test_an_outbox_is_marked_by_what_the_daemon_wrote_beside_it(
    outbox: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.jsonl"
    ids = [json.loads(line)["id"] for line in lines_of(outbox, out)]
    beside = DoubtFile(outbox.with_name("doubts.jsonl"))
    beside.add({"text": "names nothing"})
    interval = {"from_ns": "0", "until_ns": "1", "flags": "stale"}
    for point_id in ids[:2]:
        beside.add({**interval, "points": point_id})
    beside.close()
    marked = [json.loads(line) for line in lines_of(outbox, out)]
    assert ["stale" in p["quality"]["flags"] for p in marked] == [True, True, False]
    listed = [invoke("points", "export", "--db", outbox, "--format", "jsonl").stdout]
    listed.append(invoke("points", "list", "--db", outbox, "--session", SESSION).stdout)
    assert [text.count("stale") for text in listed] == [2, 2]


def lines_of(source: Path, out: Path) -> list[str]:
    export(source, "--to", "jsonl", "--out", out, "--force")
    return out.read_text().splitlines()


def test_scans_of_a_recording_keep_their_last_bit_and_their_times(
    recording: Path, tmp_path: Path
) -> None:
    out = tmp_path / "scan.npz"
    export(recording, "--kind", "scans", "--to", "npz", "--out", out)
    with np.load(out) as columns:
        np.testing.assert_array_equal(columns["xyz_mm"], SCAN.xyz_mm)
        expected_ns = SCAN.time_ns + np.asarray(SCAN.dtime_ns)
        np.testing.assert_array_equal(columns["time_ns"], expected_ns)
        np.testing.assert_array_equal(columns["quality"], SCAN.quality)


def test_filters_are_those_of_the_daemon(lines: Path, tmp_path: Path) -> None:
    filters = tmp_path / "filters.toml"
    filters.write_text(
        '[[filters]]\nkind = "slab"\nnormal = [1, 0, 0]\nfrom_mm = 5\nto_mm = 25\n'
    )
    out = tmp_path / "some.jsonl"
    ran = export(lines, "--to", "jsonl", "--filters", filters, "--out", out)
    kept = [json.loads(line)["seq"] for line in out.read_text().splitlines()]
    assert kept == [1, 2]
    assert "filter slab: 1 held back" in ran.stderr
    filters.write_text('[[filters]]\nkind = "slap"\n')
    other = tmp_path / "other.csv"
    ran = export(lines, "--filters", filters, "--out", other, status=2)
    assert "did you mean 'slab'" in ran.stderr
    filters.write_text(
        '[[filters]]\nkind = "sections"\nnormal = [1, 0, 0]\nspacing_mm = 1\n'
    )
    ran = export(lines, "--filters", filters, "--out", other, status=2)
    assert "--kind scans" in ran.stderr


def test_a_campaign_of_labelled_points_can_be_read(tmp_path: Path) -> None:
    good = {"quality": Quality(ok=True, flags=())}
    lines = tmp_path / "good.jsonl"
    points = [p.model_copy(update=good) for p in ALL]
    lines.write_bytes(b"".join(encode(p, "json") + b"\n" for p in points))
    (tmp_path / "plan.toml").write_text(ONE_CONE)
    folder = tmp_path / "monday"
    options = ("--to", "campaign", "--arm", DEMO_ARM, "--campaign")
    export(lines, *options, tmp_path / "plan.toml", "--out", folder)
    names = [f"J{k}" for k in range(1, 8)]
    campaign = read_campaign(folder, names)
    np.testing.assert_array_equal(
        campaign.poses.angles_rad, [p.angles_rad for p in POINTS[:3]]
    )
    ran = export(lines, *options, tmp_path / "plan.toml", "--out", folder, status=2)
    assert "is not empty" in ran.stderr


def test_a_campaign_takes_no_flagged_points_and_says_which(tmp_path: Path) -> None:
    flags = [(), ("interpolated",), ("turns_uncertain", "geometry_unknown"), ("skew",)]
    points = [
        labelled(seq, 1.0).model_copy(
            update={"quality": Quality(ok=seq < 2, flags=of_point)}
        )
        for seq, of_point in enumerate(flags)
    ]
    path = tmp_path / "p.jsonl"
    path.write_bytes(b"".join(encode(p, "json") + b"\n" for p in points))
    (tmp_path / "plan.toml").write_text(ONE_CONE)
    options = ("--to", "campaign", "--arm", DEMO_ARM)
    options = (*options, "--campaign", tmp_path / "plan.toml", "--out")
    output = export(path, *options, tmp_path / "strict").stderr
    assert "2 points were left out because of flags" in output
    assert "  turns_uncertain: 1 point; " in output
    assert "  skew: 1 point; " in output
    output = export(
        path, *options, tmp_path / "lax", "--allow", "skew", "--json"
    ).stdout
    report = json.loads(output)
    assert report["poses"] == 3
    assert report["flagged"] == {"turns_uncertain": 1}
    refused = export(path, *options, tmp_path / "no", "--allow", "blue", status=2)
    assert "no quality flag blue" in refused.stderr


def test_labels_that_the_campaign_does_not_know_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.jsonl"
    path.write_bytes(encode(labelled(0, 1.0, "stool"), "json") + b"\n")
    (tmp_path / "plan.toml").write_text(ONE_CONE)
    options = ("--to", "campaign", "--arm", DEMO_ARM, "--campaign")
    ran = export(path, *options, tmp_path / "plan.toml", status=2)
    assert "labelled 'stool', which is not in the campaign; there are: seat" in (
        ran.stderr
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--to", "doc"), "--to doc: one of"),
        (("--kind", "lines"), "one of 'points', 'scans'"),
        (("--to", "text", "--template", "{os}"), "is no value of a point"),
        (("--template", "{seq}"), "needs --to text"),
        (("--to", "ply", "--decimal", ","), "needs --to csv, text or xyz"),
        (("--kind", "scans"), "expected a recording"),
        (("--to", "campaign"), "needs --arm and --campaign"),
    ],
)
def test_what_does_not_go_together_is_refused_and_nothing_is_written(
    lines: Path, tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    before = set(tmp_path.iterdir())
    ran = export(lines, *options, "--out", tmp_path / "out", status=2)
    assert message in ran.stderr
    assert set(tmp_path.iterdir()) == before


def test_a_damaged_line_is_named(lines: Path, tmp_path: Path) -> None:
    lines.write_bytes(lines.read_bytes().replace(b'"seq":2', b'"seq":-2'))
    ran = export(lines, "--out", tmp_path / "o.csv", status=2)
    assert "line 3" in ran.stderr
    assert not (tmp_path / "o.csv").exists()
    lines.write_text("hello")
    assert "is no recording" in export(lines, status=2).stderr


@pytest.mark.parametrize(
    ("to", "lacks"),
    [
        ("xyz", "what is in doubt is not marked"),
        ("ply", "ids and times"),
        ("dxf", "times, and numbers"),
        ("ros2", "ids, labels"),
        ("npz", ""),
        ("parquet", ""),
        ("qif", ""),
        ("csv", ""),
        ("jsonl", ""),
        ("text --template {x};{y}", "what is in doubt is not marked"),
        ("text --template {x};{ok}", ""),
        ("text --template {x};{flags}", ""),
    ],
)
def test_what_a_format_cannot_carry_is_said(
    to: str, lacks: str, lines: Path, tmp_path: Path
) -> None:
    out, words = tmp_path / "out", ("--to", *to.split())
    ran = export(lines, *words, "--out", out)
    assert "3 points, 3 in doubt" in ran.stderr
    assert ("not in this file" in ran.stderr) == bool(lacks)
    assert lacks in ran.stderr
    report = json.loads(export(lines, *words, "--out", out, "--force", "--json").stdout)
    assert report["in_doubt"] == 3
    assert lacks in report["lacks"]


@pytest.mark.parametrize("to", ["csv", "jsonl", "npz", "parquet", "ply", "xyz"])
def test_part_coordinates_without_an_alignment_are_refused(
    to: str, lines: Path, tmp_path: Path
) -> None:
    out = tmp_path / f"out.{to}"
    words = ("--to", to, "--coordinates", "part", "--out", out)
    ran = export(lines, *words, status=2)
    assert "was taken without an alignment" in ran.stderr
    assert "align the arm before you measure" in ran.stderr
    assert "Exception" not in ran.stderr
    assert not out.exists()
