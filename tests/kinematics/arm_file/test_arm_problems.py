import re
from datetime import UTC, datetime

import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import ARM_TEXT
from traverse.kinematics.arm_file.arm import parse_arm, read_arm
from traverse.strict_toml.problems import FileError

EVERYTHING_WRONG = """\
schema = "traverse/arm/2"
name = "a/b"
origin_mm = [0.0, 0.0]
colour = "red"

[[joints]]
name = "J1"
axis = [0.0, 0.0, 0.0]
link = [0.0, 0.0, 250.0]
zero_rad = nan
mass_kg = "2"
[joints.encoder]
counts_per_turn = 4294967297
sign = 0
source = "base0"

[[joints]]
name = "J1"
axis = [0, true, 0]
link_mm = [0, inf, 4]
zero_rad = "0.5"
[joints.encoder]
counts_per_turn = 0
sign = true
source = "base/1"

[[joints]]
name = "J 3"
axis = [0, 0, -0.0]
link_mm = [0, 0, 1, 4]
zero_rad = -inf
encoder = { counts_per_turn = 8.0, sign = 1, source = "base/1", bits = 8 }

[[joints]]
name = ""
axis = "z"
link_mm = [0, 0, 0]
zero_rad = false
mass_kg = -1.0
encoder = 3

[probe]
radius_mm = -3.0
kind = "soft"
direction = [0.0, 0.0, 0.0]

[identification]
date = 5
parameter = ["J1.axis.v"]

[[effects]]
kind = "encoder_ecentricity"
joint = "J1"
cos_rad = 3.1e-5

[[effects]]
kind = "base_step"
at_s = "3"
step = [1.0, 2.0, 3.0]
joint = "J1"

[[effects]]
cos_rad = 1

[[effects]]
kind = "encoder_harmonic"
order = 1
joint = "J9"
cos_rad = 1
sin_rad = 1.0
epoch_utc = 2026-11-20T09:00:00
"""
_PLACES = """
schema name origin_mm colour joints[0].axis joints[0].link joints[0].link_mm
joints[0].zero_rad joints[0].mass_kg joints[0].encoder.counts_per_turn
joints[0].encoder.sign joints[0].encoder.source joints[1].name joints[1].axis[1]
joints[1].link_mm[1] joints[1].zero_rad joints[1].encoder.counts_per_turn
joints[1].encoder.sign joints[2].name joints[2].axis joints[2].link_mm
joints[2].zero_rad joints[2].encoder.counts_per_turn joints[2].encoder.source
joints[2].encoder.bits joints[3].name joints[3].axis joints[3].zero_rad
joints[3].mass_kg joints[3].encoder probe.radius_mm probe.kind probe.direction
identification.date identification.parameter effects[0].kind
effects[1].joint effects[1].epoch_utc effects[1].at_s effects[1].step
effects[1].step_mm effects[2].kind effects[3].joint effects[3].order
effects[3].epoch_utc
"""
ALL_PLACES = _PLACES.split()


def problems_of(text):
    with pytest.raises(FileError) as caught:
        parse_arm(text, "bench.toml")
    return {problem.where: problem.message for problem in caught.value.problems}


def test_all_mistakes_of_a_file_are_reported_at_once_each_with_its_key_path():
    with pytest.raises(FileError) as caught:
        parse_arm(EVERYTHING_WRONG, "bench.toml")
    places = [problem.where for problem in caught.value.problems]
    assert sorted(places) == sorted(ALL_PLACES)
    lines = str(caught.value).splitlines()
    assert lines[0] == f"bench.toml: {len(ALL_PLACES)} problems"
    assert [line.split(":")[0] for line in lines[1:]] == [f"  {p}" for p in places]
    assert "pydantic" not in str(caught.value)


def test_problems_come_in_the_order_of_the_file():
    places = [p.split("[")[0].split(".")[0] for p in problems_of(EVERYTHING_WRONG)]
    tables = "schema name origin_mm colour joints probe identification effects"
    assert list(dict.fromkeys(places)) == tables.split()


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ("schema", "'traverse/arm/2' is not valid here; expected 'traverse/arm/1'"),
        ("origin_mm", "has 2 entries, which is too few"),
        (
            "joints[0].link",
            "unknown key 'link'; did you mean 'link_mm'? units are part of the name",
        ),
        ("joints[0].link_mm", "is missing; add it"),
        ("joints[0].zero_rad", "nan is not a finite number"),
        ("joints[0].mass_kg", "'2' is not a number"),
        (
            "joints[0].encoder.counts_per_turn",
            "4294967297 is too large; it must be at most 4294967296",
        ),
        ("joints[0].encoder.sign", "0 is not valid here; expected 1 or -1"),
        ("joints[1].axis[1]", "true is not a number"),
        ("joints[1].encoder.sign", "true is not an integer"),
        ("joints[1].name", "'J1' is also the name of joints[0]; names must differ"),
        (
            "joints[2].link_mm",
            "has 4 entries; expected at most 3; a decimal comma separates entries: "
            "write 250.0, not 250,0",
        ),
        ("joints[3].axis", "'z' is not a list"),
        ("joints[3].encoder", "3 is not a table of keys"),
        ("probe.kind", "'soft' is not valid here; expected 'hard' or 'switching'"),
        (
            "identification.parameter",
            "unknown key 'parameter'; did you mean 'parameters'?",
        ),
        (
            "effects[0].kind",
            "unknown kind 'encoder_ecentricity'; did you mean 'encoder_eccentricity'?",
        ),
        (
            "effects[1].step",
            "unknown key 'step'; did you mean 'step_mm'? units are part of the name",
        ),
        ("effects[1].joint", "does not belong to base_step: remove it"),
    ],
)
def test_messages_say_what_was_found_and_what_was_expected(where, message):
    assert problems_of(EVERYTHING_WRONG)[where] == message


@pytest.mark.parametrize(
    "name", ["", "  ", "a/b", "a+", "#", "a\\u0000", "a\\u009f", "\\n", "x" * 65]
)
def test_arm_names_that_break_topics_are_refused(name):
    assert list(problems_of(ARM_TEXT.replace("bench-7", name))) == ["name"]


@pytest.mark.parametrize(
    "source", ["", "/0", "base", "base/", "base/x", "base/01", "a/b/0", "a b/0", "b/-1"]
)
def test_sources_without_device_and_channel_are_refused(source):
    text = ARM_TEXT.replace("base/1", source)
    assert list(problems_of(text)) == ["joints[1].encoder.source"]


def test_shank_without_direction_needs_a_link_to_lie_along():
    text = ARM_TEXT.replace("direction = [0.0, 0.0, 1.0]\n", "")
    parse_arm(text)
    text = text.replace("[0.0, 0.0, 50.0]", "[0.0, 0.0, -300.0]")
    assert list(problems_of(text)) == ["probe.direction"]


@pytest.mark.parametrize(
    ("first", "second", "where", "message"),
    [
        (
            '"J3"\nratio = 1.0',
            None,
            "[0].coupled_to",
            "unknown joint 'J3'; known here: J1",
        ),
        ('"J1"\nratio = 1.0', None, "[0].coupled_to", "couples J1 to J1: a ring;"),
        (
            '"J2"\nratio = 1.0',
            '"J1"\nratio = -0.5',
            "[1].coupled_to",
            "couples J2 to J1 to J2: a ring; leave one of them out",
        ),
        (None, '"J1"', "[1]", "ratio is missing; a coupling has both"),
        (None, '"J1"\nratio = inf', "[1].ratio", "inf is not a finite number"),
    ],
)
def test_couplings_name_another_joint_in_no_ring(first, second, where, message):
    text = ARM_TEXT
    for zero, coupling in (("1.234", first), ("-0.5", second)):
        if coupling is not None:
            line = f"zero_rad = {zero}\n"
            text = text.replace(line, f"{line}coupled_to = {coupling}\n")
    assert problems_of(text)[f"joints{where}"].startswith(message)


def test_arm_without_joints_is_refused():
    head, _, rest = ARM_TEXT.partition("[[joints]]")
    tail = rest[rest.index("[probe]") :]
    assert list(problems_of(head + tail)) == ["joints"]
    assert list(problems_of(f"{head}joints = []\n{tail}")) == ["joints"]


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("x = [1,", "line 1, column 8"),
        ("a = 1\nb = 2 2", "line 2, column 7"),
        ("a = 1\na = 2\n", "line 2, column 6"),
        ("x = 1\n\ny = ", "line 3, column 5"),
    ],
)
def test_broken_toml_is_reported_with_line_and_column(text, where):
    assert list(problems_of(text)) == [where]


@pytest.mark.parametrize("text", ["\ufeffx = 1\n", "x\0 \0=\0 1\0"])
def test_what_an_editor_wrote_that_does_not_write_utf_8_is_told(text):
    (problem,) = problems_of(text).values()
    assert problem.endswith("save the file as UTF-8 without a byte order mark")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = " + "9" * 5000, "not TOML"),
        ("x = " + "[" * 50_000, "nested more than 32 deep"),
        ("x = " + "[" * 40 + "]" * 40, "nested more than 32 deep"),
    ],
)
def test_excessive_toml_is_refused_like_broken_toml(text, expected):
    assert expected in problems_of(text)[""]


def test_missing_and_unreadable_files_are_refused_with_the_reason(tmp_path):
    with pytest.raises(FileError, match=r"nowhere\.toml: 1 problem\n.*No such file"):
        read_arm(tmp_path / "nowhere.toml")
    with pytest.raises(FileError, match="Is a directory"):
        read_arm(tmp_path)
    path = tmp_path / "latin.toml"
    path.write_bytes('a = 1\nname = "m\u00fcll"\n'.encode("latin-1"))
    with pytest.raises(FileError) as caught:
        read_arm(path)
    [problem] = caught.value.problems
    assert problem.where == "line 2, column 10"
    assert "0xfc is not UTF-8" in problem.message


junk = st.recursive(
    st.one_of(
        st.integers(-(2**63), 2**63),
        st.sampled_from([10**400, -1, 0, 1, 2]),
        st.floats(),
        st.text(max_size=5),
        st.booleans(),
        st.just(datetime(2026, 1, 1, tzinfo=UTC)),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from(["kind", "name", "x"]), inner, max_size=3),
    ),
    max_leaves=8,
)


def places_in(value, path=()):
    yield path
    entries = value.items() if isinstance(value, dict) else enumerate(value)
    for key, entry in entries if isinstance(value, dict | list) else ():
        if isinstance(entry, dict | list):
            yield from places_in(entry, (*path, key))
        else:
            yield (*path, key)


def holds(owner, step):
    if isinstance(owner, dict):
        return step in owner
    return isinstance(owner, list) and isinstance(step, int) and step < len(owner)


def effects_text():
    return ARM_TEXT + (
        '[[effects]]\nkind = "axis_runout"\njoint = "J1"\ncomponent = "radial"\n'
        "order = 2\ncos_mm = [0.1, 0.0, 0.0]\nsin_mm = [0.0, 0.0, 0.0]\n"
        '[[effects]]\nkind = "empirical"\njoint = "J2"\ncovariate = "time_s"\n'
        "knots = [0.0, 1.0]\nvalues_rad = [0.0, 1e-6]\n"
    )


@given(st.data())
def test_whatever_stands_in_a_file_it_is_read_or_refused_in_our_words(data):
    table = tomlkit.parse(effects_text()).unwrap()
    places = [p for p in places_in(table) if p]
    for path in data.draw(st.lists(st.sampled_from(places), min_size=1, max_size=3)):
        owner = table
        for step in path[:-1]:
            # An earlier change may have taken the place away.
            owner = owner[step] if holds(owner, step) else None
        if holds(owner, path[-1]):
            owner[path[-1]] = data.draw(junk)
    try:
        parse_arm(tomlkit.dumps(table))
    except FileError as error:
        message = str(error)
    else:
        message = ""
    assert not re.search(r"pydantic|http|Input should", message)
