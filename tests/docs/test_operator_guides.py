import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.docs.shell import PATIENCE_S, Shell, as_run
from tests.docs.telling import blocks, numbers_of, printed_blocks, words_of
from tests.end_to_end.workbench import REST, Workbench, rest
from tests.mosquitto import Mosquitto
from traverse.testing.waiting import until

PART = "docs/how-to/measure-a-part.md"
PROBE = "docs/how-to/change-a-probe.md"
# The part's places A to D, turned by 30 degrees about z, at 480 -120 40 mm.
PLACES_MM = {
    "A": "480.0, -120.0, 40.0",
    "B": "653.205, -20.0, 40.0",
    "C": "578.205, 109.904, 40.0",
    "D": "405.0, 9.904, 80.0",
}
SEAT = '[[motion]]\nkind = "cone"\nartefact = "{}"\nseat_mm = [{}]\npostures = {}'
LEAD_IN = rest(2.0)
TO_BROKER = re.compile(
    r"traverse (collect|session|label|point$|undo|probe use|.*--(send|clear))"
)


class Guide:
    """A page whose commands are carried out in order, while the arm touches.

    Args:
        page: of the documentation.
        bench: with the configurations, and the files that the page shows.
        motions: of the simulated operator, after the collection has begun.
    """

    def __init__(self, page: str, bench: Workbench, *motions: str) -> None:
        self.lines = [
            block for block in printed_blocks(page) if "leapfrog" not in block[0]
        ]
        self.bench, self.session = bench, ""
        bench.write_simulator(
            LEAD_IN, *motions, REST, arm="noise_rad = 2e-6\n[arm.deviations]"
        )

    async def is_followed(self) -> None:
        """Run the commands; each prints as the page shows."""
        (collect,) = [line for line, _ in self.lines if "traverse collect" in line]
        with self.bench.simulator() as simulator:
            await simulator.says("ready base")
            with self._shell(collect) as collecting:
                await collecting.says("following")
                with self.bench.daemon() as daemon:
                    for line, shown in self.lines:
                        if line == collect:
                            printed = await collecting.ends()
                        else:
                            printed = await self._carried_out(line)
                        _assert_shown(printed, shown)
                    assert await daemon.stop() == 0

    def _shell(self, line: str) -> Shell:
        line = line.replace("5c1f...", self.session)
        if TO_BROKER.match(line):
            line += f" --broker 127.0.0.1:{self.bench.port}"
        name = f"said-{len(list(self.bench.folder.glob('*.said')))}"
        return Shell(self.bench.folder, name, as_run(line, self.bench.port))

    async def _carried_out(self, line: str) -> str:
        asks = "traverse probe pivot" in line and "--yes" not in line
        with self._shell(line) as shell:
            if not asks:
                printed = await shell.ends()
            else:
                ended = shell.process.poll
                await until(lambda: ended() is not None, line, PATIENCE_S)
                assert ended() == 1  # beyond the limit, and not confirmed
                printed = shell.output
        if "traverse session" in line:
            self.session = printed.strip()
        return printed


def _assert_shown(printed: str, shown: list[str]) -> None:
    """Every line of the page is printed, its figures nearly so."""
    for line in shown:
        same = [
            printed_line
            for printed_line in printed.splitlines()
            if words_of(printed_line) == words_of(line)
        ]
        expected = pytest.approx(numbers_of(line), rel=0.05, abs=0.005)
        assert expected in [numbers_of(printed_line) for printed_line in same], (
            line,
            printed,
        )


@pytest.fixture
def bench(make_mosquitto: Callable[..., Mosquitto], tmp_path: Path) -> Workbench:
    """An arm and a daemon that reads its files from a folder."""
    broker = make_mosquitto()
    bench = Workbench(tmp_path, broker.host, broker.port, "bench-7")
    bench.write_daemon(capture="live_rate_hz = 100.0")
    return bench


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_a_part_is_measured_as_told(bench: Workbench) -> None:
    (bench.folder / "part.csv").write_text(blocks(PART, "csv")[0])
    (bench.folder / "part").mkdir()
    (bench.folder / "part" / "campaign.toml").write_text(blocks(PART, "toml")[0])
    seats = [SEAT.format(name, place, 2) for name, place in PLACES_MM.items()]
    guide = Guide(PART, bench, *seats)
    await guide.is_followed()
    header, row = (bench.folder / "housing-17.csv").read_text().splitlines()
    values = dict(zip(header.split(","), row.split(","), strict=True))
    # Taken and taken back: the retraction leaves no row but the head's.
    assert values["part_x_mm"]


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_a_probe_is_changed_and_qualified_as_told(bench: Workbench) -> None:
    library, campaign = blocks(PROBE, "toml")
    (bench.folder / "probes.toml").write_text(library)
    (bench.folder / "pivot").mkdir()
    (bench.folder / "pivot" / "campaign.toml").write_text(campaign)
    daemon = bench.folder / "daemon.toml"
    named = 'file = "arm.toml"\nprobes = "probes.toml"'
    daemon.write_text(daemon.read_text().replace('file = "arm.toml"', named, 1))
    seat = SEAT.format("seat", "600.0, -150.0, 60.0", 12)
    await Guide(PROBE, bench, seat).is_followed()
    assert "vector_covariance_mm2" in (bench.folder / "probes.toml").read_text()
