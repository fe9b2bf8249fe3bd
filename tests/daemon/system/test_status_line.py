"""What `systemctl status` shows."""

import re

from traverse.daemon.system.systemd import StatusLine


def test_what_is_well_is_short():
    line = StatusLine()
    assert line.text("measuring", {"base": "ready"}, "connected", 0) == (
        "measuring: 1 device"
    )
    two = {"base": "ready", "wrist": "ready"}
    assert line.text("measuring", two, "connected", 1) == (
        "measuring: 2 devices, 1 point waits"
    )


def test_what_is_missing_is_reported_with_the_time_since_when():
    line = StatusLine()
    devices = {"base": "ready", "wrist": "lost"}
    first = line.text("measuring", devices, "lost", 12)
    time = r"\d\d:\d\d:\d\d"
    told = rf"measuring: 1 device, wrist lost since {time}, broker lost since {time}, "
    assert re.fullmatch(f"{told}12 points wait", first)


def test_the_time_is_that_of_the_change():
    now = ["12:00:00"]
    line = StatusLine(lambda: now[0])

    def told(state: str) -> str:
        return line.text("measuring", {"base": state}, "connected", 0)

    assert told("lost") == "measuring: 0 devices, base lost since 12:00:00"
    now[0] = "12:00:07"
    assert told("lost") == "measuring: 0 devices, base lost since 12:00:00"
    assert told("ready") == "measuring: 1 device"
    assert told("lost") == "measuring: 0 devices, base lost since 12:00:07"
