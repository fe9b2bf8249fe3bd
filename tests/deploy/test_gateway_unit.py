import json
import re
from pathlib import Path

import pytest

from tests.deploy.places import DEPLOY, output_of
from tests.end_to_end.programs import Program
from tests.mosquitto import HOST, Mosquitto
from tests.protocol.message_examples import STATUS
from traverse.protocol.encoding import encode
from traverse.protocol.topics import status_topic

UNIT = (DEPLOY / "systemd/traverse-gateway@.service").read_text("utf-8")
TOPIC = "homeassistant/device/traverse_bench-7/config"


@pytest.mark.needs("mosquitto")
def test_home_assistant_is_told_of_an_arm_by_the_unit(tmp_path: Path) -> None:
    (gateway,) = re.findall(r"^# (GATEWAY)=(.*)$", UNIT, re.M)
    (line,) = re.findall(r"^ExecStart=/usr/bin/traverse (.*)$", UNIT, re.M)
    broker = Mosquitto(tmp_path)
    broker.start()
    port = ("-h", HOST, "-p", str(broker.port))
    status = encode(STATUS, "json").decode()
    output_of("mosquitto_pub", *port, "-r", "-t", status_topic("bench-7"), "-m", status)
    words = line.replace(f"${gateway[0]}", gateway[1]).split()
    try:
        with Program(tmp_path, "gateway", *words, f"--broker={HOST}:{broker.port}"):
            once = ("-C", "1", "-W", "20", "-t", TOPIC)
            announced = output_of("mosquitto_sub", *port, *once)
    finally:
        broker.stop()
    assert json.loads(announced)["device"]["identifiers"]
