"""Seven simulated encoders on vcan0, and their daemon.

By a simulated board's button the truth log records when the ball is touched; the
daemon does not read it.
"""

from pathlib import Path

from tests.end_to_end.workbench import SPHERE, Workbench
from tests.vm.bus_checks import NODES
from tests.vm.can_interface import NAME

N_POINTS, N_TOUCHES = 3, 60  # more than the checks last
HELD_S = 12.0  # the arm rests while the button is held: then a point is requested
TRACKING_HZ = 10.0
REST = '[[motion]]\nkind = "rest"\nduration_s = {}'
ENCODERS = f"""\
kind = "canopen"
interface = "socketcan"
channel = "{NAME}"
nodes = {list(NODES)}
encoder_turns = 64
[[device]]
id = "handle"
port = "handle.pty"
inputs = ["button"]
"""
DRIVER = f"""\
driver = "canopen"
interface = "socketcan"
channel = "{NAME}"
nodes = {list(NODES)}
sync = "kernel"
heartbeat_ms = 1000
answer_s = 2.0
late_s = 0.5
"""


def write_files(bench: Workbench) -> None:
    motions = [REST.format(5.0), SPHERE.format(points=N_TOUCHES), REST.format(10_000.0)]

    bench.write_simulator(*motions, board=ENCODERS)
    replace(bench.folder / "simulator.toml", 'port = "board.pty"\n', "")
    replace(bench.folder / "simulator.toml", "dwell_s = 0.06", "dwell_s = 1.0")
    replace(bench.folder / "simulator.toml", "press_s = 0.03", f"press_s = {HELD_S}")
    bench.write_daemon(capture=f"tracking_rate_hz = {TRACKING_HZ}")
    daemon = bench.folder / "daemon.toml"
    replace(daemon, 'inputs = [{ source = "base/0", trigger = "button" }]', "")
    replace(daemon, f'driver = "latch-board"\nport = "{bench.pty}"', DRIVER)
    replace(daemon, "period_s = 0.2", "period_s = 1.0")


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    assert old in text, f"{path.name} has no {old!r}"
    path.write_text(text.replace(old, new), "utf-8")
