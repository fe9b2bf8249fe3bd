"""The probe library, and the command that changes probes between two samples."""

import asyncio
import hashlib

import numpy as np
import pytest

from tests.daemon.arm_harness import ArmBench, edge
from tests.daemon.effect_entries import effect
from tests.daemon.two_devices import BEGIN_NS, ON_TWO
from tests.daemon.values import ARM, arm_file, arm_model
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.inputs import StartupError, read_inputs
from traverse.daemon.pose.arm_model import model_with_probe, read_model
from traverse.daemon.pose.probe_library import read_probes
from traverse.kinematics.arm_file.arm import arm_digest, parse_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.protocol.messages import PointArgs, ProbeArgs
from traverse.strict_toml.problems import FileError

LIBRARY = """\
schema = "traverse/probes/1"
[[probes]]
name = "ball-6"
radius_mm = 3.0
vector_mm = [0.0, 0.0, 50.0]
direction = [0.0, 0.0, 1.0]
kind = "hard"
date = 2026-11-20
[[probes]]
name = "long"
radius_mm = 1.5
vector_mm = [10.0, 0.0, 120.0]
kind = "switching"
vector_covariance_mm2 = [4e-4, 0.0, 0.0, 4e-4, 0.0, 9e-4]
"""
PROBE_OF_ARM = ARM[ARM.index("[probe]") : ARM.index("[reference]")]
LONG_PROBE = """\
[probe]
radius_mm = 1.5
kind = "switching"
vector_mm = [10.0, 0.0, 120.0]

"""


def library(folder, text=LIBRARY):
    path = folder / "probes.toml"
    path.write_text(text)
    return path


def test_a_library_is_read_and_probes_are_found_by_name(tmp_path):
    probes = read_probes(library(tmp_path))
    assert probes.names == ("ball-6", "long")
    assert probes.named("long").radius_mm == 1.5
    assert probes.named("short") is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "long"', 'name = "ball-6"', "occurs twice"),
        ("radius_mm = 1.5", "radius_mm = -1.5", "must be at least 0"),
        ("direction = [0.0, 0.0, 1.0]", "direction = [0, 0, 0]", "has no length"),
        ("[4e-4, 0.0,", "[4e-4, 1.0,", "negative eigenvalue"),
        ('kind = "hard"', 'kind = "soft"', "kind"),
        ('kind = "hard"', 'kind = "hard"\ncolour = "red"', "colour"),
        ("probes/1", "probes/2", "schema"),
    ],
)
def test_mistakes_of_a_library_are_reported(tmp_path, old, new, message):
    with pytest.raises(FileError, match=message):
        read_probes(library(tmp_path, LIBRARY.replace(old, new)))


def test_an_arm_with_another_probe_is_that_of_a_file_with_it(tmp_path):
    model = read_model(arm_file(tmp_path), {"base": None})
    chosen = read_probes(library(tmp_path)).named("long")
    changed = model_with_probe(model, chosen)
    text = ARM.replace(PROBE_OF_ARM, LONG_PROBE)
    same = read_model(arm_file(tmp_path, text), {"base": None})
    assert changed.digest == same.digest == arm_digest(parse_arm(text))
    assert changed.digest != model.digest
    assert changed.probe_radius_mm == 1.5
    angles_rad = np.array([[1.5, -0.2, 0.9]])
    places_mm = [probe_centre(m.geometry, angles_rad)[0] for m in (changed, same)]
    assert places_mm[0] == pytest.approx(places_mm[1], abs=1e-12)
    again = read_probes(library(tmp_path)).named("ball-6")
    assert model_with_probe(changed, again).digest == model.digest


def test_estimated_moments_stay_with_another_probe(tmp_path):
    soft = 'kind = "joint_compliance"\njoint = "J2"\ncompliance_rad_nm = 1e-5\n'
    moment = 'kind = "first_moment"\njoint = "J3"\nmoment_kg_m = [0.5, 0.0, 0.0]\n'
    tables = "".join(f"[[effects]]\n{table}" for table in (soft, moment))
    model = arm_model(tmp_path, ARM + tables)
    for name in ("long", "ball-6"):
        changed = model_with_probe(model, read_probes(library(tmp_path)).named(name))
        levers_kg_mm = [
            variant.effects.levers_kg_mm(variant.geometry)
            for variant in (changed, model)
        ]
        assert levers_kg_mm[0] == pytest.approx(levers_kg_mm[1])


def test_what_is_known_of_a_probe_goes_with_it(tmp_path):
    names = ["J1.link.x", "probe.vector.x", "probe.vector.z"]
    file = tmp_path / "arm.cov.npz"
    np.savez(file, names=names, covariance=np.diag([1e-4, 25e-4, 25e-4]))
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    text = f'{ARM}[identification]\ncovariance_file = "arm.cov.npz"\n'
    text += f'covariance_digest = "{digest}"\n'
    model = read_model(arm_file(tmp_path, text), {"base": None})
    probes = read_probes(library(tmp_path))
    known = np.diag(model_with_probe(model, probes.named("long")).covariance.covariance)
    assert sorted(known[known > 0.0]) == pytest.approx([1e-4, 4e-4, 4e-4, 9e-4])
    unknown = model_with_probe(model, probes.named("ball-6")).covariance.covariance
    assert sorted(np.diag(unknown)[np.diag(unknown) > 0.0]) == pytest.approx([1e-4])
    plain = read_model(arm_file(tmp_path), {"base": None})
    assert model_with_probe(plain, probes.named("ball-6")).covariance is None


@pytest.fixture
async def bench(arm_bench):
    arm_bench.stream(0, 40)
    return arm_bench


def requests(bench, path):
    bench.statuses.clear()
    return PointCommands(bench.measurement, path), bench.statuses


async def test_points_after_the_change_are_of_the_new_probe(bench, tmp_path):
    probes, changes = requests(bench, library(tmp_path))
    before = bench.model.digest
    bench.take(edge("handle", BEGIN_NS + 305_000_000, 0))
    bench.take(edge("handle", BEGIN_NS + 405_000_000, 1))  # its readings will arrive
    changing = asyncio.create_task(probes.change_probe(ProbeArgs(name="long")))
    await asyncio.sleep(0.05)  # the library is read in another thread
    bench.take(edge("handle", BEGIN_NS + 415_000_000, 2))
    bench.stream(40, 60)
    result = await changing
    bench.take(edge("handle", BEGIN_NS + 575_000_000, 3))
    bench.stream(60, 62)  # motion is evaluated anew from the change on
    models = [point.model for point in bench.points]
    assert models[:2] == [before] * 2
    assert models[-1] == result["model"] != before
    assert [p.probe_radius_mm for p in bench.points][-1] == result["radius_mm"] == 1.5
    assert len(models) == 4
    assert [model for _, model in changes] == [result["model"]]
    assert "capture.probe" in bench.codes()
    assert bench.points[0].counts == bench.points[-1].counts  # turns are kept


async def test_a_fault_of_the_daemon_while_a_change_waits_refuses_the_probe(
    bench, tmp_path
):
    probes, _ = requests(bench, library(tmp_path))
    bench.statuses = None  # so that telling the new status fails
    with pytest.raises(RequestRefusedError, match="AttributeError") as refusal:
        await probes.change_probe(ProbeArgs(name="long"))
    assert refusal.value.code == "capture.probe_refused"
    assert "log" in refusal.value.remedy


async def test_a_mean_is_of_one_probe(bench, tmp_path):
    probes, _ = requests(bench, library(tmp_path))
    asking = asyncio.create_task(bench.point_requests.take_point(PointArgs(samples=20)))
    await asyncio.sleep(0)
    changing = asyncio.create_task(probes.change_probe(ProbeArgs(name="long")))
    await asyncio.sleep(0.05)
    bench.stream(40, 50)
    assert not changing.done()
    bench.stream(50, 70)
    await asking
    await changing
    assert bench.points[0].probe_radius_mm == 3.0
    assert bench.measurement.model.probe_radius_mm == 1.5


async def test_probes_that_are_not_there_are_refused_with_those_that_are(
    bench, tmp_path
):
    probes, changes = requests(bench, library(tmp_path))
    with pytest.raises(
        RequestRefusedError, match="no probe 'short'; it has: ball-6, long"
    ):
        await probes.change_probe(ProbeArgs(name="short"))
    none, _ = requests(bench, None)
    with pytest.raises(RequestRefusedError, match="names no probe library") as refusal:
        await none.change_probe(ProbeArgs(name="short"))
    assert refusal.value.code == "command.not_available"
    library(tmp_path, "nonsense = 1")
    with pytest.raises(RequestRefusedError, match="schema") as refusal:
        await probes.change_probe(ProbeArgs(name="long"))
    assert refusal.value.code == "capture.probe_refused"
    assert changes == []


def started(folder):
    arm_file(folder)
    configuration = folder / "daemon.toml"
    configuration.write_text(
        '[arm]\nfile = "arm.toml"\nprobes = "probes.toml"\n[broker]\n[[device]]\n'
        'id = "base"\ndriver = "latch-board"\nport = "/dev/null"\n'
    )
    return read_inputs(configuration, embedded=False)


async def test_a_chosen_probe_is_in_use_after_a_restart(bench, tmp_path):
    path = library(tmp_path)
    assert started(tmp_path).probe is None
    in_use = tmp_path / "state" / "probe.json"
    in_use.parent.mkdir()
    commands = PointCommands(bench.measurement, path, probe_in_use=in_use)
    await commands.change_probe(ProbeArgs(name="long"))
    assert started(tmp_path).probe == read_probes(path).named("long")
    library(tmp_path, LIBRARY.replace("120.0", "119.0"))  # it was qualified since
    assert started(tmp_path).probe.vector_mm == (10.0, 0.0, 119.0)

    bench.statuses = None  # so that telling the new status fails
    with pytest.raises(RequestRefusedError, match="AttributeError"):
        await commands.change_probe(ProbeArgs(name="ball-6"))
    assert started(tmp_path).probe.name == "long"


async def test_without_a_disk_a_probe_is_not_changed(bench, tmp_path):
    """After a restart another one would be in use."""
    nowhere = tmp_path / "missing" / "probe.json"
    commands = PointCommands(bench.measurement, library(tmp_path), probe_in_use=nowhere)
    with pytest.raises(RequestRefusedError, match="after a restart another probe"):
        await commands.change_probe(ProbeArgs(name="long"))
    assert bench.measurement.probe is None


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (
            '{"schema": "traverse/probe-in-use/1", "name": "short"}',
            "no probe library of the configuration has 'short'",
        ),
        ('{"name": "long"}', "no name and schema"),
        ('["long"]', "no name and schema"),
        ("\0", "not known"),
    ],
)
def test_no_other_probe_takes_the_place_of_the_one_in_use(tmp_path, written, message):
    library(tmp_path)
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "probe.json").write_text(written)
    with pytest.raises(StartupError, match=message) as refusal:
        started(tmp_path)
    assert "deleting this file" in str(refusal.value)


async def test_a_probe_that_the_effects_cannot_have_is_refused(tmp_path):
    text = ON_TWO.replace("[probe]", "[probe]\nmass_kg = 0.2")
    for joint in ("J1", "J2", "J3"):
        text = text.replace(f'name = "{joint}"', f'name = "{joint}"\nmass_kg = 1.0')
    text += effect("joint_compliance", joint='"J2"', compliance_rad_nm=1e-5)
    model = read_model(arm_file(tmp_path, text), {"base": None, "wrist": None})
    bench = ArmBench(tmp_path, model)
    probes, _ = requests(bench, library(tmp_path))
    try:
        with pytest.raises(RequestRefusedError, match="mass") as refusal:
            await probes.change_probe(ProbeArgs(name="long"))
    finally:
        bench.close()
    assert refusal.value.code == "capture.probe_refused"
    assert bench.measurement.model is model
