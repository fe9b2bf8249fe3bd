"""A recorded run replayed: every point the same to the last bit, however it is cut."""

import asyncio
from dataclasses import dataclass

import pytest

from tests.daemon.recorder.recorded_runs import RecordedRun, replayed
from traverse.daemon.executor import MeasurementCommand
from traverse.daemon.replay.replay import Replay
from traverse.drivers.base.values import DeviceAlarm, DeviceTemperatures, StreamStarted
from traverse.protocol.messages import Label
from traverse.recording.maps import bytes_to_map, map_to_bytes
from traverse.recording.run_reader import RunReader
from traverse.recording.run_writer import Entry, RunHead, RunWriter

BLOCKS = (None, 1, 7, 1000)
SCAN = {"id": "s1", "rate_hz": 100.0, "every": 1}
MEAN = {"dwell_ns": None, "speed_mm_s": 5000.0, "spread_mm": 100.0}


async def busy(run):
    run.later(0.3)
    for number in range(12):
        run.later(0.11)
        run.click()
        match number:
            case 1:
                run.ask("label", artefact="cone", feature=None)
            case 2:
                run.ask("take_mean", samples=20, **MEAN)
            case 3:
                run.ask("undo", id=None)
            case 4:
                run.ask("take_now")
            case 5:
                run.ask("start_scan", **SCAN)
                run.take(StreamStarted("base", 1, 100.0))
            case 6:
                run.clock.offset_ns += 12_345_678
                run.steps.related(run.clock.now_ns, run.clock.offset_ns)
            case 8:
                run.ask("stop_scan")
                run.take(DeviceAlarm("base", 1, True, "worn", "worn", 0))
            case 9:
                run.ask("session", note="second")
            case 10:
                turn = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
                part = {"rotation": turn, "translation_mm": (1.0, 2.0, 3.0)}
                run.ask("align", action="set", name=None, scale=1.1, **part)
                run.take(DeviceTemperatures("base", (21.5,)))
    run.later(1.5)


def recorded(folder, **options):
    async def both():
        async with RecordedRun(folder, **options) as run:
            first = await run.recorder.begin("first", "")
            await busy(run)
            await run.recorder.finish()
            run.later(7.0)
            second = await run.recorder.begin("second", "")
            for _ in range(9):
                run.later(0.9)
                run.click()
            run.later(1.0)
            await run.recorder.finish()
        return first, second, run

    return asyncio.run(both())


@pytest.mark.slow
@pytest.mark.parametrize(("two", "method"), [(False, "pretouch"), (True, "pulled")])
def test_points_and_scans_are_the_same(tmp_path, two, method):
    first, second, run = recorded(
        tmp_path, two=two, capture=f'compensation = "{method}"'
    )
    n = 14 + two  # one board latches: it gets no request for a point of its stream
    for block in (None, 1) if two else BLOCKS:
        result, points = replayed(first, block)
        assert result.holds
        assert result.points.sure.same == result.points.sure.n == n
        assert result.scans.tally.same == result.scans.tally.n > 30
        assert (result.points.early.n, result.points.missing, result.points.new) == (
            0,
            0,
            0,
        )
        assert result.tear is None
        if block is None:
            assert points == run.points[:n]
    for block in (None,) if two else BLOCKS:
        result, points = replayed(second, block)
        assert result.holds
        assert result.points.sure.same == result.points.sure.n >= 5
        assert result.scans.left_out == 0
        assert len(points) >= 9


@pytest.mark.slow
def test_covariance_of_interpolated_points_is_excused_where_blocks_are_cut(tmp_path):
    first, _, _ = recorded(tmp_path, two=True)
    assert replayed(first)[0].points.excused == 0
    in_single_samples = replayed(first, 1)[0]
    assert in_single_samples.points.excused > 0
    assert in_single_samples.holds


@pytest.fixture
def planted():
    """Defines a command that this version does not have."""

    @dataclass(frozen=True)
    class RenumberFrom(MeasurementCommand[None], recorded_name="planted"):
        seq: int

        def _apply(self, measurement, now_ns):
            measurement.capture.session.next_seq = self.seq
            measurement.capture.label = Label(artefact="planted")

    yield RenumberFrom
    MeasurementCommand.classes.pop("planted", None)


def with_planted(folder, planted):
    """A recording of three points, with the command before the last."""

    async def run():
        async with RecordedRun(folder) as run:
            path = await run.recorder.begin("first", "")
            run.later(0.3)
            for seq in (None, None, 40):
                run.later(0.2)
                if seq is not None:
                    planted(seq).execute(run.measurement)
                run.click()
            run.later(1.0)
            await run.recorder.finish()
        return path, run.points

    return asyncio.run(run())


def test_a_new_command_is_replayed_without_a_branch_for_it(tmp_path, planted):
    path, points = with_planted(tmp_path, planted)
    result, again = replayed(path)
    assert [point.seq for point in points] == [0, 1, 40]
    assert again == points
    assert result.holds


def test_a_command_that_a_replay_lacks_is_an_error(tmp_path, planted):
    path, _ = with_planted(tmp_path, planted)
    del MeasurementCommand.classes["planted"]
    with pytest.raises(ValueError, match=r"planted.*recorded by this version"):
        replayed(path)


def test_a_command_without_an_effect_cannot_be_made():
    class Forgotten(MeasurementCommand[None], recorded_name="forgotten"):
        pass

    del MeasurementCommand.classes["forgotten"]
    with pytest.raises(TypeError, match="apply"):
        Forgotten()


def altered(path, alter):
    other = path.with_name("altered.mcap")
    with RunReader(path) as reader:
        head = RunHead({**reader.about}, dict(reader.files))
        with RunWriter(other, head) as writer:
            for entry in reader:
                for changed in alter(entry):
                    writer.add(changed)
    return other


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The recording from the start, which those of what is wrong are made from."""
    return recorded(tmp_path_factory.mktemp("recorded"))[0]


def test_one_count_more_is_found(first):
    seen = []

    def alter(entry):
        if entry.topic == "device/base/latch" and not seen:
            seen.append(entry)
            table = bytes_to_map(entry.content)
            counts = list(table["counts"])
            counts[1] += 1
            content = map_to_bytes({**table, "counts": counts})
            return [Entry(entry.topic, entry.log_ns, content)]
        return [entry]

    result, _ = replayed(altered(first, alter))
    assert not result.holds
    assert result.points.sure.same == result.points.sure.n - 1
    assert 0.0 < result.points.sure.largest_mm < 0.1
    assert "xyz_mm" in result.points.sure.differing


def test_a_missing_point_and_a_missing_edge_are_found(first):
    points = iter(range(100))
    without_point = altered(
        first, lambda e: [] if e.topic == "point" and next(points) == 3 else [e]
    )
    result, _ = replayed(without_point)
    assert (result.points.new, result.points.missing, result.holds) == (1, 0, True)
    edges = iter(range(100))
    without_edge = altered(
        first,
        lambda e: [] if e.topic == "device/base/latch" and next(edges) == 4 else [e],
    )
    result, _ = replayed(without_edge)
    assert result.points.missing == 1
    assert not result.holds


def test_another_kernel_may_differ_by_a_little(first):
    path = first.with_name("other.mcap")
    with RunReader(first) as reader:
        head = RunHead({**reader.about, "kernel": "another"}, dict(reader.files))
        with RunWriter(path, head) as writer:
            for entry in reader:
                writer.add(entry)
    result, _ = replayed(path)
    assert result.kernel_then == "another"
    assert result.points.sure.within == result.points.sure.n
    assert result.holds
    # A reach of 0.8 m is known to 2^-43 mm or so.
    assert result.points.tolerance_mm == 4 * 2.0**-43


def test_a_recording_without_its_arm_is_refused(first):
    path = first.with_name("bare.mcap")
    with RunReader(first) as reader, RunWriter(path, RunHead(reader.about)) as writer:
        for entry in reader:
            writer.add(entry)
    with pytest.raises(ValueError, match=r"lacks arm\.toml, traverse\.toml"):
        replayed(path)


def test_steps_that_make_no_sense_are_refused(tmp_path):
    path = tmp_path / "odd.mcap"
    with RunWriter(path, RunHead({})) as writer:
        writer.add(Entry("steps", 1, map_to_bytes({"is": "state"})))
    with pytest.raises(ValueError, match="a step makes no sense"):
        replayed(path)

    async def empty():
        with RunWriter(path, RunHead({})) as writer:
            writer.add(Entry("log", 1, b"{}"))
        with RunReader(path) as reader:
            return Replay(reader).run()

    with pytest.raises(ValueError, match="no state to begin with"):
        asyncio.run(empty())
