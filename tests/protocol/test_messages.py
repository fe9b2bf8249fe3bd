import numpy as np
import pytest
from pydantic import ValidationError

from tests.protocol.message_examples import (
    EVENT,
    EXAMPLES,
    HEALTH,
    LAST_WILL,
    POINT,
    REFUSAL,
    REPLY,
    RETRACTION,
    SCAN,
    STATUS,
)
from traverse.protocol.encoding import parse_args
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import (
    FLAG_MEANINGS,
    MESSAGES,
    AlignArgs,
    Command,
    Message,
    Quality,
    QualityFlag,
    Scan,
    ScanArgs,
    Value,
    flag_names,
)


def changed(message: Message, **changes: object) -> Message:
    values = {name: value for name, value in dict(message).items() if name != "schema_"}
    return type(message).model_validate(values | changes)


LATENCY = {"p50_us": 1, "p99_us": 1, "max_us": 2, "n": 1, "histogram": (1, *(0,) * 18)}
REFUSED = [
    (STATUS, {"online": False}, "online false"),
    (LAST_WILL, {"online": True}, "online false"),
    (STATUS, {"arm": "a/b"}, "pattern"),
    (STATUS, {"arm": ""}, "pattern"),
    (POINT, {"counts": (1, 2)}, "not 2 and 7"),
    (POINT, {"surface_mm": None}, "surface_mm"),
    (POINT, {"compensation": "none"}, "surface_mm"),
    (POINT, {"retracts": POINT.id}, "other than that of the retracted point"),
    (POINT, {"xyz_mm": (1.0, 2.0, float("nan"))}, "finite"),
    (POINT, {"xyz_mm": (1.0, 2.0)}, "required"),
    (POINT, {"samples": 0}, "greater than or equal to 1"),
    (POINT, {"samples": True}, "valid integer"),
    (POINT, {"time_ns": 2**63}, "less than or equal"),
    (POINT, {"seq": "17"}, "valid integer"),
    (POINT, {"spread_mm": -0.1}, "greater than or equal to 0"),
    (POINT, {"more": 1}, "not permitted"),
    (SCAN, {"xyz_mm": SCAN.xyz_mm[:1]}, "2 rows in xyz_mm"),
    (SCAN, {"xyz_mm": SCAN.xyz_mm[:, :2]}, r"shape \(n, 3\), not \(2, 2\)"),
    (SCAN, {"xyz_mm": SCAN.xyz_mm[0]}, "shape"),
    (SCAN, {"xyz_mm": SCAN.xyz_mm.astype(np.float32)}, "float64, not float32"),
    (SCAN, {"xyz_mm": SCAN.xyz_mm * np.nan}, "finite"),
    (SCAN, {"xyz_mm": [[1.0, 2.0, 3.0], [1.0, 2.0]]}, "equal length"),
    (SCAN, {"xyz_mm": [[1.0, 2.0, "3"], [1.0, 2.0, 3.0]]}, "numbers of float64"),
    (SCAN, {"quality": [0, 1.0]}, "numbers of uint32"),
    (SCAN, {"quality": [0, 1 << 32]}, "range of uint32"),
    (SCAN, {"quality": 0}, "shape"),
    (SCAN, {"counts": SCAN.counts[:, :1]}, "as many joints"),
    (SCAN, {"dtime_ns": np.array([1, 0])}, "never decreasing"),
    (SCAN, {"dtime_ns": np.array([-1, 0])}, "from 0 upwards"),
    (SCAN, {"total": None}, "a total in the last block"),
    (SCAN, {"last": False}, "a total in the last block"),
    (EVENT, {"code": "lost"}, "pattern"),
    (EVENT, {"last_ns": 0}, "last_ns not before first_ns"),
    (EVENT, {"severity": "fatal"}, "'info', 'warning' or 'error'"),
    (HEALTH, {"counters": {"Lost": 1}}, "pattern"),
    (HEALTH, {"latencies": {"x": {**LATENCY, "p99_us": 0}}}, "p50_us <= p99_us"),
    (HEALTH, {"latencies": {"x": {**LATENCY, "n": 2}}}, "a histogram of n"),
    (HEALTH, {"latencies": {"x": {**LATENCY, "histogram": (1,)}}}, "at least 19 items"),
    (REPLY, {"ok": False}, "a result where ok is true"),
    (REFUSAL, {"ok": True}, "a result where ok is true"),
    (REFUSAL, {"result": {}}, "a result where ok is true"),
]


@pytest.mark.parametrize(("message", "changes", "phrase"), REFUSED)
def test_message_that_contradicts_itself_is_refused(message, changes, phrase):
    with pytest.raises(ValidationError, match=phrase):
        changed(message, **changes)


@pytest.mark.parametrize("name", EXAMPLES)
def test_equality_is_by_value(name):
    example = EXAMPLES[name]
    assert changed(example) == example
    assert all(example != other for key, other in EXAMPLES.items() if key != name)


def test_scans_that_differ_in_one_element_are_not_equal():
    moved = SCAN.xyz_mm.copy()
    moved[1, 2] = np.nextafter(moved[1, 2], np.inf)
    assert changed(SCAN, xyz_mm=moved) != SCAN
    assert changed(SCAN, counts=None) != SCAN


def test_points_have_a_hash_that_agrees_with_equality():
    assert len({POINT, changed(POINT), RETRACTION}) == 2


@pytest.mark.parametrize("name", EXAMPLES)
def test_messages_are_frozen(name):
    with pytest.raises(ValidationError, match="frozen"):
        EXAMPLES[name].schema_ = "traverse/other/1"


def test_an_array_changed_after_the_scan_was_made_does_not_change_it():
    mine = np.zeros((2, 3))
    scan = changed(SCAN, xyz_mm=mine)
    mine[:] = 1.0
    assert not scan.xyz_mm.any()


def test_last_block_may_be_without_points():
    nothing = np.zeros((0, 7))
    empty = changed(
        SCAN,
        dtime_ns=np.zeros(0, np.int64),
        xyz_mm=nothing[:, :3],
        ijk=nothing[:, :3],
        angles_rad=nothing,
        counts=None,
        covariance_mm2=None,
        quality=np.zeros(0, np.uint32),
    )
    assert isinstance(empty, Scan)
    assert empty.xyz_mm.shape == (0, 3)


def test_retraction_repeats_the_measurement_under_its_own_number():
    assert RETRACTION.retracts == POINT.id
    differing = {
        name for name, value in dict(POINT).items() if dict(RETRACTION)[name] != value
    }
    assert differing == {"seq", "id", "retracts", "trigger", "time_ns"}


def test_every_flag_has_one_bit_and_a_meaning():
    assert sorted(FLAG_MEANINGS) == [1 << bit for bit in range(23)]
    assert set(FLAG_MEANINGS) == set(QualityFlag)


def test_bits_become_names_and_a_verdict():
    assert flag_names(0b100001) == ("encoder_error", "overspeed")
    assert flag_names(1 << 23) == ("bit_23",)
    assert Quality.from_bits(0) == Quality(ok=True, flags=())
    assert Quality.from_bits(1 << 14) == Quality(ok=True, flags=("interpolated",))
    assert Quality.from_bits(1 << 14 | 2) == Quality(
        ok=False, flags=("encoder_warning", "interpolated")
    )
    assert not Quality.from_bits(1 << 20).ok


def test_bad_quality_needs_a_reason():
    with pytest.raises(ValidationError, match="a flag that says why"):
        Quality(ok=False, flags=())


@pytest.mark.parametrize(
    ("command", "args", "phrase"),
    [
        ("point", {"samples": 3, "dwell_s": 1.0}, "not both"),
        ("point", {"samples": 0}, r"args\.samples: 0"),
        ("scan", {}, r"args\.action: nothing"),
        ("scan", {"action": "start", "rate_hz": 0.0}, "greater than 0"),
        ("scan", {"action": "start", "rate_hz": 10_001}, "10000"),
        ("scan", {"action": "start", "mode": "distance"}, "spacing_mm"),
        (
            "scan",
            {"action": "start", "mode": "planes", "spacing_mm": 1.0},
            "a normal of length above 0",
        ),
        ("undo", {"id": ""}, "at least 1 character"),
        ("label", {"feature": "1"}, "an artefact where there is a feature"),
        ("probe", {}, r"args\.name: nothing"),
        ("reload", {"force": True}, r"args\.force: a key that"),
        ("align", {"action": "set"}, "rotation and translation_mm"),
        ("session", {"action": "old"}, "'new'"),
        ("resend", {"session": "s", "from_seq": 4, "to_seq": 3}, "not below from_seq"),
        ("resend", {"session": "s", "from_seq": -1, "to_seq": 3}, "from_seq"),
    ],
)
def test_wrong_arguments_are_refused(command, args, phrase):
    with pytest.raises(MessageError, match=phrase):
        parse_args(command, args)


def test_short_arguments_are_enough():
    assert parse_args("point", {}).samples is None
    assert parse_args("scan", {"action": "stop"}) == ScanArgs(action="stop")
    assert parse_args("align", {"action": "clear"}) == AlignArgs(action="clear")
    resend = parse_args("resend", {"session": "s"})
    assert (resend.from_seq, resend.to_seq) == (0, None)
    assert parse_args("resend", {}).session is None


def test_envelope_carries_only_what_was_said():
    envelope = Command.carrying(ScanArgs(action="stop"), request="r")
    assert envelope.args == {"action": "stop"}


@pytest.mark.parametrize(
    "rotation",
    [
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.1)),
        ((1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 0.8)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ],
)
def test_only_a_proper_rotation_aligns(rotation):
    with pytest.raises(ValidationError, match="a proper rotation"):
        AlignArgs(action="set", rotation=rotation, translation_mm=(0.0, 0.0, 0.0))


def test_every_field_of_every_value_is_described():
    kinds: list[type[Value]] = [Value]
    for kind in kinds:
        kinds += kind.__subclasses__()
    assert set(MESSAGES) < set(kinds)
    for kind in kinds:
        keys = kind.model_json_schema()["properties"]
        for name, field in kind.model_fields.items():
            assert keys[field.alias or name]["description"], f"{kind.__name__}.{name}"


@pytest.mark.parametrize(
    ("data", "phrase"),
    [
        ({"": 1}, "keys of 1 to 64 characters"),
        ({1: 1}, "keys of 1 to 64 characters"),
        ({"a": {"b" * 65: 1}}, r"in 'a\.' keys of 1 to 64"),
        ({"a": (1, (2, float("nan")))}, r"in 'a\.1\.1' a finite number"),
        ({"a": -(2**53)}, "in 'a' an integer from -9007199254740991"),
        ({"a": "x" * 2001}, "at most 2000 characters"),
        ({"a": "\ud800"}, "characters of Unicode"),
        ({"a": (0,) * 4097}, "at most 4096 elements"),
        ({"a": {str(i): 0 for i in range(4097)}}, "at most 4096 keys"),
        ({"a": b"x"}, "not bytes"),
        ({"a": {1, 2}}, "not set"),
        ("text", "a map, not str"),
    ],
)
def test_data_that_json_cannot_say_is_refused(data, phrase):
    with pytest.raises(ValidationError, match=phrase):
        changed(EVENT, data=data)


def test_lists_in_data_become_tuples():
    assert changed(EVENT, data={"a": [1, [2.5, None]]}).data == {"a": (1, (2.5, None))}
