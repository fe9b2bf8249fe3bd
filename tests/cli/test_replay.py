import json

import pytest

from tests.running import invoke
from traverse.cli.replay import report_of, report_text
from traverse.daemon.replay.compare import (
    PointComparison,
    ReplayResult,
    ScanComparison,
    Tally,
)
from traverse.recording.run_writer import RunHead, RunWriter


def made_result(
    *,
    points=None,
    early=None,
    missing=0,
    new=0,
    not_kept=0,
    excused=0,
    left_out=0,
    **of,
):
    compared = PointComparison(tolerance_mm=4.5e-13)
    compared.sure = points or Tally(n=3, same=3, within=3)
    compared.early = early or Tally()
    compared.not_kept, compared.excused = not_kept, excused
    compared._then[1,] = [None] * missing
    compared._now[2,] = [None] * new
    scans = ScanComparison()
    scans.left_out = left_out
    figures = {
        "samples": 500,
        "gaps": 0,
        "kernel_then": "avx2",
        "kernel_now": "avx2",
        "tear": None,
    }
    return ReplayResult(compared, scans, **{**figures, **of})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file or directory; check the path"),
        (b"not a recording", "no MCAP file"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, content, message):
    path = tmp_path / "a.mcap"
    if content is not None:
        path.write_bytes(content)
    assert message in invoke("replay", path, status=2).output


def test_a_recording_without_steps_is_refused(tmp_path):
    path = tmp_path / "a.mcap"
    RunWriter(path, RunHead({})).close()
    assert "no state to begin with" in invoke("replay", path, status=2).output


def test_a_broker_that_is_not_there_and_a_wrong_name_are_reported():
    words = ("record", "two words", "--arm-name", "a", "--broker", "ftp://x")
    assert "expected host" in invoke(*words, status=2).output


@pytest.mark.parametrize(
    ("changes", "holds", "lines"),
    [
        ({}, True, ["3 of 3 points the same to the last bit", "the same"]),
        ({"points": Tally(n=3, same=2)}, False, ["2 of 3 points", "NOT the same"]),
        ({"missing": 1}, False, ["missing: 1 point,", "NOT the same"]),
        (
            {"kernel_now": "numpy", "points": Tally(n=3, same=0, within=3)},
            True,
            ["TRAVERSE_KERNEL=avx2 takes that one", "3 of 3 within 4 ulp of the reach"],
        ),
        ({"kernel_now": "numpy", "points": Tally(n=3)}, False, ["NOT within"]),
        (
            {"new": 2, "not_kept": 1, "gaps": 1, "tear": "torn after 7 bytes: x"},
            True,
            ["2 points more", "(1 could not be kept then)", "1 gap:", "torn after 7"],
        ),
        ({"early": Tally(n=4, same=3)}, True, ["not judged: 3 of 4"]),
        ({"excused": 5, "left_out": 9}, True, ["5 interpolated", "9 points of scans"]),
    ],
)
def test_a_report_says_what_holds_and_what_does_not(changes, holds, lines):
    result = made_result(**changes)
    text = report_text({"arm": "bench-7"}, result)
    for line in lines:
        assert line in text
    table = json.loads(report_of({"arm": "bench-7"}, result))
    assert table["holds"] is result.holds is holds
    assert table["about"] == {"arm": "bench-7"}
