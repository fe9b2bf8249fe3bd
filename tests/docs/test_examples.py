import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import paho.mqtt.publish
import pytest

from tests.docs.pages import CHECKOUT, examples, kinds_of_examples, text_of
from tests.lab.simulated import (
    arm_value,
    cones,
    disturbed,
    seven_joints,
    simulate,
    written,
)
from tests.mosquitto import Mosquitto
from tests.protocol.message_examples import GOLDEN
from tests.running import run_program
from traverse.client.inspection.plan import Plan, plan_problems
from traverse.daemon.config.schema import read_configuration
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.identification.identify import identify
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.strict_toml.reader import read_strict

END_S = 30.0


def read_simulator(path: Path) -> object:
    return read_strict(path, SimulatorConfig, config_problems)


def read_beside_arm_and_broker(path: Path) -> object:
    beside = '[arm]\nfile = "arm.toml"\n[broker]\n'
    path.write_text(beside + path.read_text("utf-8"), "utf-8")
    return read_configuration(path)


def read_with_the_poses_shown(path: Path) -> object:
    ((_, poses),) = examples("poses")
    (path.parent / "poses.csv").write_text(poses, "utf-8")
    path.rename(path.parent / "campaign.toml")
    return read_campaign(path.parent, ["J1", "J2"])


def read_in_the_arm_shown(path: Path) -> object:
    ((_, arm),) = examples("arm")
    return parse_arm(arm.replace("[probe]", path.read_text("utf-8") + "[probe]", 1))


def read_with_the_tools_shown(path: Path) -> object:
    ((_, campaign),), ((_, poses),) = examples("campaign"), examples("tooled")
    (path.parent / "poses.csv").write_text(poses, "utf-8")
    text = campaign + path.read_text("utf-8")
    (path.parent / "campaign.toml").write_text(text, "utf-8")
    read = read_campaign(
        path.parent, ["J1", "J2"], several_tools=True, orientations=True
    )
    assert read.poses.tools is not None
    assert read.poses.tools.tolist() == [0, 1, 2]
    return read


def read_with_the_orientations_shown(path: Path) -> object:
    ((_, poses),) = examples("oriented")
    (path.parent / "poses.csv").write_text(poses, "utf-8")
    path.rename(path.parent / "campaign.toml")
    read = read_campaign(
        path.parent, ["J1", "J2"], several_tools=True, orientations=True
    )
    assert read.orientation_rad == 5e-5
    assert read.poses.oriented.tolist() == [True, True, False]
    return read


def read_and_identified(path: Path) -> object:
    """A table of artefacts is touched with cones by a simulated arm."""
    tables = tomllib.loads(path.read_text("utf-8"))["artefacts"]
    arm = seven_joints()
    shown = simulate(arm, [*tables, *cones(2)], 50, seed=3, travel_rad=2.5)
    campaign = read_campaign(written(shown, path.parent), shown.joint_names)
    identified = identify(campaign, arm_value(disturbed(arm, seed=3)))
    assert identified.converged
    assert identified.excluded == ()
    assert identified.global_test.passed
    return identified


READERS: dict[str, Callable[[Path], object]] = {
    "arm": lambda path: parse_arm(path.read_text("utf-8")),
    "joint": read_in_the_arm_shown,
    "daemon": read_configuration,
    "device": read_beside_arm_and_broker,
    "features": lambda path: read_strict(path, Plan, plan_problems),
    "simulator": read_simulator,
    "campaign": read_with_the_poses_shown,
    "artefact": read_and_identified,
    "tools": read_with_the_tools_shown,
    "tracker": read_with_the_orientations_shown,
}
FILES = [(kind, *example) for kind in READERS for example in examples(kind)]


def test_every_kind_of_example_is_known_here() -> None:
    plain_kinds = {"output", "points", "arrays", "poses", "tooled", "oriented"}
    assert kinds_of_examples() == {*READERS} | plain_kinds


@pytest.mark.parametrize(
    ("kind", "page", "text"),
    FILES,
    ids=[f"{kind} in {page}" for kind, page, _ in FILES],
)
def test_files_shown_are_good(kind: str, page: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / f"{kind}.toml"
    file.write_text(text, "utf-8")
    READERS[kind](file)


@pytest.mark.parametrize(("page", "text"), examples("output"))
def test_programs_print_what_the_page_shows(page: str, text: str) -> None:
    after = text_of(page).partition(text)[2]
    shown = re.search(r"```text\n(.*?)```", after, re.DOTALL)
    assert shown is not None
    ran = run_program(sys.executable, "-W", "error", "-c", text, cwd=CHECKOUT)
    assert ran.stdout == shown[1]


def test_array_reader_reads_a_scan() -> None:
    ((_, text),) = examples("arrays")
    names: dict[str, Any] = {}
    exec(compile(text, "example", "exec"), names)
    payload = bytes.fromhex((GOLDEN / "scan.msgpack.hex").read_text("ascii"))
    scan = names["decoded"](payload)
    expected = json.loads((GOLDEN / "scan.json").read_text("utf-8"))
    for name in ("dtime_ns", "xyz_mm", "counts", "quality"):
        np.testing.assert_array_equal(scan[name], expected[name])


@contextmanager
def running(program: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.needs("mosquitto")
def test_point_reader_prints_a_point(mosquitto: Mosquitto) -> None:
    ((_, text),) = examples("points")
    assert "1883" in text
    payload = bytes.fromhex((GOLDEN / "point.msgpack.hex").read_text("ascii"))
    expected = json.loads((GOLDEN / "point.json").read_text("utf-8"))
    topic = "traverse/documentation/point"
    # Retained, so that the reader may subscribe before or after it.
    with running(text.replace("1883", str(mosquitto.port))) as reader:
        publish(mosquitto, topic, payload)
        assert reader.stdout is not None
        line = reader.stdout.readline()
    publish(mosquitto, topic, b"")
    words = [expected["arm"], expected["seq"], *expected["xyz_mm"]]
    assert line.split() == [*map(str, words), str(expected["quality"]["ok"])]


def publish(mosquitto: Mosquitto, topic: str, payload: bytes) -> None:
    paho.mqtt.publish.single(
        topic, payload, qos=1, retain=True, hostname=mosquitto.host, port=mosquitto.port
    )
