import pickle
import struct

import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import ARM_TEXT
from traverse.kinematics.arm_file.arm import (
    Arm,
    arm_digest,
    effect_from_table,
    parse_arm,
    read_arm,
    write_arm,
)
from traverse.strict_toml.problems import LARGEST, FileError

EVERYTHING = (
    ARM_TEXT
    + """
[identification]
sigma0 = 1.02
redundancy = 742
date = 2026-11-20T09:00:00.25Z
campaign_digest = "ab12"
parameters = ["J1.link.v", "J2.axis.w"]
covariance_file = "arm.cov.npz"
covariance_digest = "cd34"

[[effects]]
kind = "encoder_eccentricity"
joint = "J2"
cos_rad = 3.1e-5
sin_rad = -1.2e-5

[[effects]]
kind = "base_step"
epoch_utc = 2026-11-20T10:00:00+01:00
at_s = 12.5
step_mm = [0.1, 0.2, -0.3]
"""
)


def bits(value):
    """Every float in a value as its bits, everything else as it is."""
    if isinstance(value, dict):
        return {key: bits(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [bits(entry) for entry in value]
    return struct.pack("<d", value) if isinstance(value, float) else value


def values(arm):
    return arm.model_dump(by_alias=True, exclude_unset=True)


def test_every_value_of_a_file_is_read():
    arm = parse_arm(EVERYTHING)
    assert arm.schema_ == "traverse/arm/1"
    assert arm.name == "bench-7"
    assert arm.origin_mm == (1.0, -2.0, 3.5)
    first, second = arm.joints
    assert (first.name, second.name) == ("J1", "J2")
    assert first.axis == (0.0, 0.0, 2.0)  # as written
    assert first.link_mm == (0.0, 10.0, 250.0)
    assert (first.mass_kg, second.mass_kg) == (2.0, None)
    assert first.centre_of_mass_mm == (0.0, 0.0, 125.0)
    assert second.centre_of_mass_mm is None
    assert first.encoder is not None
    assert first.encoder.counts_per_turn == 8388608
    assert (first.encoder.device_id, first.encoder.channel) == ("base", 0)
    assert second.encoder is not None
    assert second.encoder.sign == -1
    assert arm.probe.kind == "hard"
    assert arm.reference.gravity_m_s2 == (0.0, 0.0, -9.80665)
    assert arm.identification is not None
    assert arm.identification.parameters == ("J1.link.v", "J2.axis.w")
    eccentricity, step = arm.effects
    assert eccentricity.joint == "J2"
    assert eccentricity.values == {"cos_rad": 3.1e-5, "sin_rad": -1.2e-5}
    assert step.joint is None
    assert step.epoch_utc is not None
    assert step.epoch_utc.isoformat() == "2026-11-20T10:00:00+01:00"
    assert step.values == {"at_s": 12.5, "step_mm": (0.1, 0.2, -0.3)}


def test_optional_keys_may_be_absent():
    text = "\n".join(
        line
        for line in ARM_TEXT.splitlines()
        if not line.startswith(("mass", "centre", "vector", "direction"))
    )
    arm = parse_arm(text)
    assert arm.probe.vector_mm == (0.0, 0.0, 0.0)
    assert arm.probe.direction is None
    assert arm.identification is None
    assert arm.effects == ()


def test_writing_keeps_the_layout_and_what_is_absent(tmp_path):
    path = tmp_path / "arm.toml"
    write_arm(path, parse_arm(EVERYTHING))
    written = path.read_text()
    without_comments = EVERYTHING.replace("3.1e-5", "3.1e-05")
    without_comments = without_comments.replace("-1.2e-5", "-1.2e-05")
    without_comments = without_comments.replace("00.25Z", "00.250000Z")
    assert filled_lines(written) == filled_lines(without_comments)


def filled_lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line]


def test_writing_keeps_comments_and_the_lines_that_do_not_change(tmp_path):
    path = tmp_path / "arm.toml"
    commented = "# serial number 17\n" + ARM_TEXT.replace(
        'name = "J1"', 'name = "J1"  # the base'
    ).replace("zero_rad = 1.234", "zero_rad = 1.2340  # read on the bench")
    path.write_text(commented)
    arm = parse_arm(commented)
    write_arm(path, arm)
    assert path.read_text() == commented
    moved = arm.model_copy(update={"origin_mm": (0.5, 0.0, 0.0), "effects": ()})
    write_arm(path, moved)
    text = path.read_text()
    assert "# serial number 17" in text
    assert 'name = "J1"  # the base' in text
    assert "origin_mm = [0.5, 0.0, 0.0]" in text
    assert parse_arm(text) == moved


def test_writing_removes_what_the_new_arm_does_not_have(tmp_path):
    path = tmp_path / "arm.toml"
    arm = parse_arm(EVERYTHING)
    path.write_text(EVERYTHING)
    shorter = arm.model_copy(
        update={"effects": arm.effects[1:], "identification": None}
    )
    write_arm(path, shorter)
    assert parse_arm(path.read_text()) == shorter


def test_written_file_is_plain_toml_to_another_reader(tmp_path):
    path = tmp_path / "arm.toml"
    arm = parse_arm(EVERYTHING.replace("arm.cov.npz", 'a\\"\\u007f\\n \\\\ ☃'))
    write_arm(path, arm)
    table = tomlkit.parse(path.read_text()).unwrap()
    assert table["identification"]["covariance_file"] == 'a"\x7f\n \\ ☃'
    assert table["joints"][0]["encoder"]["source"] == "base/0"


# All doubles that a file may hold, and the corners that text formats lose.
numbers = st.one_of(
    st.floats(-LARGEST, LARGEST),
    st.sampled_from([-0.0, 5e-324, -2.2e-308, LARGEST, 0.1, 1e16]),
)
vectors = st.tuples(numbers, numbers, numbers)


@given(st.data())
def test_writing_and_reading_keep_every_number_bit_for_bit(tmp_path_factory, data):
    arm = parse_arm(EVERYTHING)
    table = values(arm)
    for joint in table["joints"]:
        joint["axis"] = data.draw(vectors.filter(any))
        joint["link_mm"] = data.draw(vectors)
        joint["zero_rad"] = data.draw(numbers)
        joint["mass_kg"] = data.draw(numbers.map(abs))
    table["origin_mm"] = data.draw(vectors)
    table["probe"]["direction"] = data.draw(vectors.filter(any))
    table["reference"]["temperature_c"] = data.draw(numbers)
    table["effects"][0]["cos_rad"] = data.draw(numbers)
    table["effects"][1]["step_mm"] = data.draw(vectors)
    table["effects"][1]["at_s"] = data.draw(numbers)
    arm = Arm.model_validate(table)
    path = tmp_path_factory.mktemp("arm") / "arm.toml"
    write_arm(path, arm)
    repeated = read_arm(path)
    assert bits(values(repeated)) == bits(values(arm))
    assert arm_digest(repeated) == arm_digest(arm)
    first = path.read_bytes()
    write_arm(path, repeated)
    assert path.read_bytes() == first


def test_writing_replaces_whole_files_and_leaves_nothing_beside(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text("old")
    write_arm(path, parse_arm(ARM_TEXT))
    assert read_arm(path) == parse_arm(ARM_TEXT)
    assert list(tmp_path.iterdir()) == [path]


def test_writing_through_a_link_keeps_the_link(tmp_path):
    (tmp_path / "real").mkdir()
    link = tmp_path / "arm.toml"
    link.symlink_to(tmp_path / "real" / "arm.toml")
    write_arm(link, parse_arm(ARM_TEXT))
    assert link.is_symlink()
    assert read_arm(tmp_path / "real" / "arm.toml") == parse_arm(ARM_TEXT)


def test_arm_that_breaks_the_rules_is_not_written(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text("old")
    arm = parse_arm(ARM_TEXT)
    twice = arm.model_copy(update={"joints": (arm.joints[0], arm.joints[0])})
    with pytest.raises(FileError, match=r"joints\[1\]\.name"):
        write_arm(path, twice)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_failed_write_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "arm.toml"
    path.mkdir()  # a folder cannot be replaced by a file
    with pytest.raises(OSError, match=r"arm\.toml"):
        write_arm(path, parse_arm(ARM_TEXT))
    assert list(tmp_path.iterdir()) == [path]


def test_digest_sees_values_and_nothing_else():
    arm = parse_arm(ARM_TEXT)
    digest = arm_digest(arm)
    assert len(digest) == 64
    assert int(digest, 16) >= 0
    same = [
        "# measured in May\n" + ARM_TEXT,
        ARM_TEXT.replace("temperature_c = 20.0", "temperature_c = 20"),
        ARM_TEXT.replace("1.234", "1_2.34e-1"),
    ]
    other = [
        ARM_TEXT.replace("1.234", "1.2340000000000002"),
        ARM_TEXT.replace('name = "J2"', 'name = "J3"'),
        ARM_TEXT.replace("mass_kg = 0.2\n", ""),
        ARM_TEXT.replace("base/1", "base/2"),
    ]
    assert [arm_digest(parse_arm(text)) for text in same] == [digest] * len(same)
    digests = {arm_digest(parse_arm(text)) for text in other}
    assert len(digests | {digest}) == len(other) + 1


def test_digest_does_not_tell_a_default_from_its_absence():
    given_text = ARM_TEXT.replace("[0.0, 0.0, 50.0]", "[0.0, 0.0, 0.0]")
    absent_text = ARM_TEXT.replace("vector_mm = [0.0, 0.0, 50.0]\n", "")
    assert arm_digest(parse_arm(given_text)) == arm_digest(parse_arm(absent_text))


def test_values_are_frozen():
    arm = parse_arm(ARM_TEXT)
    with pytest.raises(ValueError, match="frozen"):
        arm.joints[0].zero_rad = 2.0
    assert hash(arm) == hash(parse_arm(ARM_TEXT))


def test_an_arm_with_effects_travels_to_another_process():
    arm = parse_arm(EVERYTHING)
    repeated = pickle.loads(pickle.dumps(arm))
    assert repeated == arm
    assert arm_digest(repeated) == arm_digest(arm)


def test_effects_are_made_from_plain_tables_too():
    table = {"kind": "backlash", "joint": "J1", "half_width_rad": 1e-5}
    effect = effect_from_table(table)
    arm = parse_arm(ARM_TEXT)
    with_effect = arm.model_copy(update={"effects": (effect,)})
    assert effect_from_table(effect) is effect
    assert arm_digest(with_effect) != arm_digest(arm)
    with pytest.raises(ValueError, match="did you mean 'backlash'"):
        effect_from_table({"kind": "back_lash"})


def test_a_hard_probe_and_gravity_downwards_need_not_be_written():
    reference = ARM_TEXT.index("[reference]")
    short = parse_arm(ARM_TEXT[:reference].replace('kind = "hard"\n', ""))
    assert short.probe.kind == "hard"
    assert short.reference.gravity_m_s2 == (0.0, 0.0, -9.80665)
    assert arm_digest(short) == arm_digest(parse_arm(ARM_TEXT))
