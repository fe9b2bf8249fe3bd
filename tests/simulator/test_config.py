import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.running import run_program
from tests.simulator.conftest import config_text, seven_text
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.devices.wrong_clock import ClockTable
from traverse.simulator.run import run_simulator
from traverse.simulator.scenario.recorded_counts import read_recording, recorded_counts
from traverse.simulator.virtual_arm import build_arm, build_script
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import parse_strict

REST = '[[motion]]\nkind = "rest"\nduration_s = 0.01\n'


def parse(text):
    return parse_strict(text, "sim.toml", SimulatorConfig, config_problems)


def test_all_mistakes_are_said_at_once():
    text = config_text(
        REST
        + '[[motion]]\nkind = "spere"\n[[motion]]\nkind = "cone"\nseat = [0, 0, 0]\n'
        + '[[device]]\nid = "base"\nport = "port/base"\n',
        head="repeat = true\nexit_at_end = true\nclok = 'fast'",
        faults='[[fault]]\nkind = "lost"\ndevice = "wrist"\n',
    )
    with pytest.raises(FileError) as caught:
        parse(text)
    message = str(caught.value)
    for part in (
        "clok",
        "motion[1].kind",
        "motion[2].seat: ",
        "motion[2].postures",
        "device[1].id",
        "device[1].port",
        "fault[0].device",
        "fault[0].probability",
        "exit_at_end",
    ):
        assert part in message, message


def test_an_unknown_kind_is_refused_for_that_alone():
    text = config_text(
        REST + '[[motion]]\nkind = "spere"\npoints = 3\n',
        faults='[[fault]]\nkind = "lots"\nprobability = 0.1\n',
    )
    with pytest.raises(FileError) as caught:
        parse(text)
    where = [problem.where for problem in caught.value.problems]
    assert where == ["motion[1].kind", "fault[0].kind"]


def test_no_motion_is_too_few():
    with pytest.raises(FileError) as caught:
        parse("motion = []\n" + config_text(""))
    assert [problem.where for problem in caught.value.problems] == ["motion"]


def test_directions_must_point_somewhere():
    text = config_text(
        '[[motion]]\nkind = "plane"\ncentre_mm = [1, 2, 3]\nnormal = [0, 0, 0]'
    )
    with pytest.raises(FileError) as caught:
        parse(text)
    assert [problem.where for problem in caught.value.problems] == ["motion[0].normal"]


def refuse(folder, capsys, text):
    (folder / "sim.toml").write_text(text)
    assert run_simulator(folder / "sim.toml") == 2
    return capsys.readouterr().err


def test_an_effect_that_cannot_be_played_is_refused(folder, capsys):
    effect = '\n[[effects]]\nkind = "mount_compliance"\ncompliance_rad_nm = 1e-5\n'
    (folder / "arm.toml").write_text(seven_text() + effect)
    message = refuse(folder, capsys, config_text(REST))
    assert "arm.file effects[0]" in message
    assert "mass_kg" in message


def test_channels_that_do_not_match_are_refused(folder, capsys):
    (folder / "arm.toml").write_text(seven_text().replace("base/3", "wrist/9"))
    message = refuse(folder, capsys, config_text(REST))
    assert "joint J4 is read at 'wrist/9'" in message
    assert "[0, 1, 2, 4, 5, 6]" in message


def test_a_missing_configuration_is_refused(tmp_path, capsys):
    assert run_simulator(tmp_path / "none.toml") == 2
    assert "none.toml" in capsys.readouterr().err


def test_a_port_that_is_a_file_is_refused(folder, capsys):
    (folder / "port").mkdir()
    (folder / "port" / "base").write_text("precious")
    message = refuse(folder, capsys, config_text(REST))
    assert "device[0].port" in message
    assert (folder / "port" / "base").read_text() == "precious"


def test_a_script_that_ends_lets_the_program_end(folder, capsys):
    text = config_text(REST, head="exit_at_end = true\ntruth_log = 'truth.jsonl'")
    (folder / "sim.toml").write_text(text)
    assert run_simulator(folder / "sim.toml") == 0
    assert capsys.readouterr().out == f"ready base {folder / 'port' / 'base'}\n"
    assert not (folder / "port" / "base").is_symlink()
    assert '"summary"' in (folder / "truth.jsonl").read_text()


def test_an_explicit_true_arm_replaces_the_deviations(folder, stage):
    (folder / "true.toml").write_text(seven_text().replace("250", "251.5"))
    text = config_text(REST).replace(
        "deviations = { links_mm = 0.2, axes_rad = 1e-3, zeros_rad = 1e-3 }",
        'true_file = "true.toml"',
    )
    (folder / "sim.toml").write_text(text)
    arm = build_arm(parse(text), folder, "sim.toml")
    assert arm.truth.mechanism.origins_mm[1].tolist() == [0.0, 0.0, 251.5]
    np.testing.assert_allclose(arm.truth.zeros_rad, 0.3 * np.arange(7), rtol=1e-15)


RECORDED = """time_s,base/0,base/1,button
5.0,10,990,0
5.5,20,10,1
6.0,10,30,0
"""


def test_recorded_counts_are_replayed_across_the_wrap(tmp_path):
    (tmp_path / "r.csv").write_text(RECORDED)
    recording = read_recording(tmp_path / "r.csv")
    assert list(recording.input_changes()) == [(0.5, "button", 1), (1.0, "button", 0)]
    source = recorded_counts(
        recording, ["base/0", "base/1"], np.array([1000, 1000]), repeat=False
    )
    counts = source.counts(
        np.array([0.0, 0.25, 0.5, 1.0, 9.0]), np.random.default_rng()
    )
    assert counts.tolist() == [[10, 990], [15, 0], [20, 10], [10, 30], [10, 30]]


def test_a_recording_is_refused_with_its_lines(tmp_path):
    bad = RECORDED.replace("5.5,20", "4.0,20").replace("6.0,10,30", "6.0,10")
    (tmp_path / "r.csv").write_text(bad)
    with pytest.raises(FileError) as caught:
        read_recording(tmp_path / "r.csv")
    assert [problem.where for problem in caught.value.problems] == [
        "line 3, column time_s",
        "line 4",
    ]


def test_a_replay_without_a_channel_is_refused(folder, capsys):
    (folder / "r.csv").write_text(RECORDED)
    message = refuse(
        folder, capsys, config_text('[[motion]]\nkind = "replay"\nfile = "r.csv"\n')
    )
    assert "no column base/2" in message


def test_a_recording_that_would_leap_is_not_repeated(folder, capsys):
    table = np.full((3, 8), 500)
    table[:, 0], table[-1, 3] = [0, 1, 2], 400_000_000
    head = ",".join(["time_s", *(f"base/{channel}" for channel in range(7))])
    np.savetxt(folder / "r.csv", table, "%d", ",", header=head, comments="")
    text = config_text('[[motion]]\nkind = "replay"\nfile = "r.csv"\n')
    message = refuse(folder, capsys, text.replace("seed =", "repeat = true\nseed =", 1))
    assert "ends elsewhere than it begins (base/2 by " in message


def test_the_simulator_runs_without_scipy_and_the_code_under_test():
    foreign = (
        "scipy",
        "serial",
        "traverse.kinematics.model.forward",
        "traverse.protocol",
        "traverse.drivers",
    )
    script = (
        "import sys, traverse.simulator.run;"
        f"print([name for name in {foreign!r} if name in sys.modules])"
    )
    done = run_program(sys.executable, "-c", script)
    assert done.stdout.strip() == "[]"


REFERENCE = Path(__file__).parents[2] / "docs" / "reference" / "simulator.md"


def reference_example():
    return REFERENCE.read_text().split("```toml\n")[1].split("```")[0]


def test_the_reference_shows_a_configuration_that_runs(folder):
    config = parse(reference_example())
    arm = build_arm(config, folder, "sim.toml")
    script = build_script(config, arm, folder, "sim.toml")
    assert len(script.events) == 2 * (12 + 12 + 12 + 16 + 1)


def test_the_reference_names_every_key_of_a_clock_with_its_default():
    (block,) = re.findall(
        r"^\[device\.clock\].*?^```", REFERENCE.read_text(), re.M | re.S
    )
    shown = tomllib.loads(block.removesuffix("```"))["device"]["clock"]
    assert shown.keys() == ClockTable.model_fields.keys()
    for name, field in ClockTable.model_fields.items():
        if name not in {"steps", "stops_at_s"}:  # by default none
            assert shown[name] == field.default, name


def test_the_reference_names_every_key_with_its_default():
    config = parse(reference_example())
    for part, required in (
        (config.operator, set()),
        (config.arm, {"file", "turn_limits_rad"}),
        (config.device[0], {"id", "port"}),
        *((motion, {"kind"}) for motion in config.motion),
    ):
        for name, field in type(part).model_fields.items():
            written = name in part.model_fields_set
            assert written or name in {"true_file", "deviations", "clock"}, name
            if not field.is_required() and name not in required and written:
                assert getattr(part, name) == field.default, name
