import pytest

from tests.protocol import message_examples as examples
from traverse.cli.common.message_lines import line
from traverse.protocol.messages import Message, Scan


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (
            examples.STATUS,
            "08:54:07.123 status degraded; base ready, wrist lost; "
            "reference of base in doubt: base has been without power",
        ),
        (examples.LAST_WILL, "08:54:07.123 status offline"),
        (
            examples.POINT,
            "08:54:07.123 point    17    612.2500   -80.5000   301.1250 mm  "
            "overspeed,empirical",
        ),
        (
            examples.RETRACTION,
            "08:54:09.123 point    18  retracts 4f1a-17  overspeed,empirical",
        ),
        (
            examples.SCAN,
            "08:54:07.123 scan scan-3 points 1000 to 1001, lost 1, dropped 0, "
            "ended with 1002",
        ),
        (
            examples.LIVE,
            "08:54:07.123 live           612.2500   -80.5000   301.1250 mm",
        ),
        (
            examples.EVENT,
            "08:54:07.123 error device.lost [base]: base: the port closed "
            "(2 times); Check the cable.",
        ),
        (
            examples.HEALTH,
            "08:54:07.123 health CPU 12.5% of a core, 73 MB, 1000 samples/s, "
            "broker connected",
        ),
        (examples.REPLY, "reply to r-1: {'seq': 17}"),
        (examples.REFUSAL, "reply to r-1: rate_hz: 0; expected above 0"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_line_says_what_the_message_says(message: Message, expected: str) -> None:
    assert line("bench-7", message) == f"bench-7  {expected}"


def test_a_block_without_points_says_so() -> None:
    arrays = ("dtime_ns", "xyz_mm", "ijk", "angles_rad", "counts", "quality")
    fields = {**dict(examples.SCAN), "part_xyz_mm": None, "covariance_mm2": None}
    fields |= {name: fields[name][:0] for name in arrays if fields[name] is not None}
    fields.pop("schema_")
    assert "scan scan-3 no points, lost 1" in line("bench-7", Scan(**fields))


def test_the_last_nanosecond_of_a_second_stays_in_it() -> None:
    fields = {**dict(examples.STATUS), "time_ns": 1795251247999999999}
    fields.pop("schema_")
    late = type(examples.STATUS)(**fields)
    assert line("bench-7", late).startswith("bench-7  08:54:07.999 ")
