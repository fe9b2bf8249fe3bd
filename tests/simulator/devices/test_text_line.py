from pathlib import Path

from tests.simulator.devices.host_side import heard, hosts_of
from tests.simulator.one_hinge import mounted
from traverse.simulator.devices.text_line import SimulatedTextLine, TextLineTable


def test_the_script_begins_with_the_first_line_that_a_host_gets(tmp_path: Path) -> None:
    table = TextLineTable(kind="text-line", id="board", port="port")
    mounting = mounted(tmp_path, table)
    mounting.clock.begin_s = None  # as with start = "first_start"
    device = SimulatedTextLine(table, mounting)
    device.live(0.995)  # nobody holds the port: lines 0 to 99 are lost
    assert device.n_readings == 100
    with hosts_of(device, tmp_path / "port") as (host,):
        device.live(2.0)
        assert heard(host).startswith(b"$TRV,100,1000,0,1000,0*")
