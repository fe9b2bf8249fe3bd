"""Reloading: the new configuration applies whole, or the old one stays."""

import asyncio
import hashlib
import socket

import numpy as np
import pytest

from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.values import ARM, arm_file, latch
from traverse.daemon.commands.points import PointCommands
from traverse.daemon.commands.reload import ConfigurationReloader
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.inputs import Inputs, read_inputs
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.capture import triggers_of
from traverse.daemon.state_dir import state_path
from traverse.daemon.system.systemd import Notifier
from traverse.drivers.base.values import DeviceUp
from traverse.protocol.messages import ProbeArgs, ReloadArgs

CONFIGURATION = """\
[arm]
file = "arm.toml"
[broker]
[[device]]
id = "base"
driver = "latch-board"
port = "/dev/null"
[capture]
inputs = [{ source = "base/0", trigger = "button" }]
"""


class Reloading:
    def __init__(self, folder) -> None:
        self.folder = folder
        self.path = folder / "daemon.toml"
        self.manager = folder / "notify"
        self.write(CONFIGURATION)
        arm_file(folder)
        configuration, model, *_ = read_inputs(self.path, embedded=False)
        self.bench = Bench(model)
        self.used = []
        self.reload = ConfigurationReloader(
            path=self.path,
            embedded=False,
            inputs=Inputs(configuration, model),
            measurement=self.bench.measurement,
            use=self.use,
            events=EventLog(self.bench.clock, self.bench.events.append),
            notifier=Notifier({"NOTIFY_SOCKET": str(self.manager)}),
        )

    def use(self, inputs):
        self.used.append(inputs)
        self.bench.measurement.apply_settings(inputs.configuration, inputs.model)
        self.bench.measurement.probe = inputs.probe

    def write(self, text):
        self.path.write_text(text)

    async def carried_out(self):
        return await self.reload.carry_out(ReloadArgs())

    async def refused(self):
        before = self.bench.measurement.model
        with pytest.raises(RequestRefusedError) as caught:
            await self.carried_out()
        assert self.used == []
        assert self.bench.measurement.model is before
        assert self.bench.codes()[-1] == caught.value.code
        return caught.value


@pytest.fixture
async def reloading(tmp_path):
    files = Reloading(tmp_path)
    files.bench.take(DeviceUp("base", BOARD, False))
    yield files
    files.bench.device.driver.close()


async def test_a_new_arm_measures_from_the_next_point_on(reloading):
    bench = reloading.bench
    bench.take(latch((5, 6, 7)))
    arm_file(reloading.folder, ARM.replace("[1.0, -2.0, 3.5]", "[1.0, -2.0, 4.5]"))
    result = await reloading.carried_out()
    bench.take(latch((5, 6, 7), token=1))
    first, second = bench.points
    assert result == {"model": second.model, "changed": ["arm"]}
    assert second.model != first.model
    assert second.xyz_mm[2] - first.xyz_mm[2] == pytest.approx(1.0, abs=1e-9)
    assert (second.counts, second.seq) == (first.counts, 1)
    assert bench.codes()[-2:] == ["reload.done", "button.pressed"]


@pytest.mark.parametrize("is_good", [True, False])
async def test_systemd_hears_that_it_begins_and_ends(reloading, is_good):
    if not is_good:
        reloading.write("colour = 1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(reloading.manager))
        await reloading.reload.on_sighup()
        heard.setblocking(False)
        first, second = heard.recv(100), heard.recv(100)
    assert first.startswith(b"RELOADING=1\nMONOTONIC_USEC=")
    assert second == b"READY=1"
    assert reloading.bench.codes()[-1] == f"reload.{'done' if is_good else 'refused'}"


async def test_turns_that_were_counted_stay_counted(reloading):
    bench = reloading.bench
    for token, counts in enumerate((0, 20_000, 40_000, 60_000)):
        bench.take(latch((0, 0, counts), token=token))
    before = bench.points[-1].angles_rad
    arm_file(reloading.folder, ARM.replace("radius_mm = 3.0", "radius_mm = 2.0"))
    await reloading.carried_out()
    bench.take(latch((0, 0, 60_000), token=4))
    assert bench.points[-1].angles_rad == before
    assert bench.points[-1].probe_radius_mm == 2.0


async def test_new_rules_apply_at_once(reloading):
    text = CONFIGURATION.replace('"base/0"', '"base/2"') + (
        '[quality]\nrefuse = ["end_stop"]\n'
        '[[quality.end_stops]]\njoint = "J1"\nlow_rad = -9.0\nhigh_rad = -0.5\n'
        '[[scan.filters]]\nkind = "grid"\nspacing_mm = 1.0\n'
    )
    reloading.write(text)
    result = await reloading.carried_out()
    assert result["changed"] == ["capture", "scan", "quality"]
    bench = reloading.bench
    assert [filter_.kind for filter_ in bench.scanner.chain.filters] == ["grid"]
    bench.take(latch((0, 0, 0)), latch((0, 0, 0), number=2, token=1))
    assert bench.points == []  # input 0 means nothing now; J1 at 0 is refused
    assert bench.codes()[-2:] == ["capture.refused", "button.pressed"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[arm]", "[arm]\nfiles = 1", "files"),
        ('file = "arm.toml"', 'file = "gone.toml"', "gone.toml"),
        ("[broker]", '[broker]\nhost = "elsewhere"', r"\[broker\]"),
        ('port = "/dev/null"', 'port = "/dev/zero"', r"\[device\]"),
        ("[capture]", "[assembly]\nwait_s = 0.1\n[capture]", r"\[assembly\]"),
        ("[capture]", "[capture]\nmax_waiting_points = 5", "max_waiting_points"),
    ],
)
async def test_what_cannot_be_is_refused_and_the_old_continues(
    reloading, old, new, words
):
    reloading.write(CONFIGURATION.replace(old, new))
    error = await reloading.refused()
    assert error.code == "reload.refused"
    assert "\n" not in str(error)
    assert words.replace("\\", "") in str(error)
    assert error.remedy


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "bench-7"', 'name = "bench-8"', "bench-7 to bench-8"),
        ('source = "base/2"', 'source = "base/0"', "same source"),
        ("sign = -1", "sign = 1", "which encoders"),
        ("link_mm", "links_mm", "links_mm"),
    ],
)
async def test_another_arm_is_refused(reloading, old, new, words):
    arm_file(reloading.folder, ARM.replace(old, new))
    error = await reloading.refused()
    assert words in str(error) or "base/0" in str(error)


def identified(folder):
    file = folder / "arm.cov.npz"
    np.savez(file, names=["J1.link.x"], covariance=np.diag([1e-4]))
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    arm_file(
        folder,
        f'{ARM}[identification]\ncovariance_file = "arm.cov.npz"\n'
        f'covariance_digest = "{digest}"\ndate = "2026-01-01"\n',
    )
    return file


@pytest.mark.parametrize("is_replaced", [False, True])
async def test_a_covariance_that_vanishes_or_is_replaced_is_not_stated(
    reloading, is_replaced
):
    """It is that of the file until a reload, which refuses what is not the arm's."""
    file = identified(reloading.folder)
    await reloading.carried_out()
    bench = reloading.bench
    assert bench.measurement.conditions.is_established("geometry")
    if is_replaced:
        np.savez(file, names=["J1.link.x"], covariance=np.diag([1e-8]))
    else:
        file.unlink()
    bench.take(latch((5, 6, 7)))
    stated = bench.measurement.model.covariance.covariance
    reloading.used.clear()
    error = await reloading.refused()
    assert "covariance" in str(error)
    assert np.array_equal(bench.measurement.model.covariance.covariance, stated)


PROBE = """\
[[probes]]
name = "long"
radius_mm = 1.5
vector_mm = [10.0, 0.0, {z_mm}]
kind = "hard"
vector_covariance_mm2 = [{xx_mm2}, 0.0, 0.0, 4e-4, 0.0, 9e-4]
"""


async def test_the_probe_in_use_is_read_again_from_its_library(reloading):
    """A vector that was corrected holds from the next point on, or is refused."""
    reloading.write(CONFIGURATION.replace("[arm]", '[arm]\nprobes = "probes.toml"'))
    library = reloading.folder / "probes.toml"

    def write(z_mm, xx_mm2=4e-4):
        text = PROBE.format(z_mm=z_mm, xx_mm2=xx_mm2)
        library.write_text(f'schema = "traverse/probes/1"\n{text}')

    write(120.0)
    bench = reloading.bench
    reloading.reload.inputs = read_inputs(reloading.path, embedded=False)
    in_use = state_path(reloading.path) / "probe.json"
    in_use.parent.mkdir()
    commands = PointCommands(bench.measurement, library, probe_in_use=in_use)
    await commands.change_probe(ProbeArgs(name="long"))
    assert (await reloading.carried_out())["changed"] == []
    bench.take(latch((5, 6, 7)))
    for z_mm, xx_mm2 in ((121.0, 4e-4), (121.0, 1e-4)):
        write(z_mm, xx_mm2)
        assert (await reloading.carried_out())["changed"] == ["arm"]
        assert bench.measurement.probe.vector_covariance_mm2[0] == xx_mm2
    bench.take(latch((5, 6, 7), token=1))
    first, second = (np.array(point.xyz_mm) for point in bench.points)
    assert np.linalg.norm(second - first) == pytest.approx(1.0)
    reloading.used.clear()
    library.unlink()
    assert "probes.toml" in str(await reloading.refused())


async def test_it_waits_until_no_point_is_being_taken(reloading):
    bench = reloading.bench
    waiting = asyncio.get_running_loop().create_future()
    bench.measurement.latches[7] = waiting, None
    arm_file(reloading.folder, ARM.replace("radius_mm = 3.0", "radius_mm = 2.0"))
    task = asyncio.create_task(reloading.carried_out())
    done, _ = await asyncio.wait({task}, timeout=0.1)
    assert not done
    assert reloading.used == []
    bench.take(latch((5, 6, 7), number=None, token=7))
    await task
    assert (await waiting).probe_radius_mm == 3.0
    assert bench.measurement.model.probe_radius_mm == 2.0


def test_every_input_keeps_its_trigger(tmp_path):
    reloading_path = tmp_path / "daemon.toml"
    reloading_path.write_text(CONFIGURATION)
    arm_file(tmp_path)
    configuration, *_ = read_inputs(reloading_path, embedded=False)
    triggers = triggers_of(configuration.capture)
    assert triggers["base", 0] == "button"
    assert ("base", 1) not in triggers
