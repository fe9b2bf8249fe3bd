import re
from pathlib import Path

import numpy as np
import pytest

from tests.client.gateways.ippdme.client import IppClient
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import SPHERE, Workbench
from tests.mosquitto import Mosquitto

CENTRE_MM = (700.0, 100.0, 120.0)  # of the sphere
RADIUS_MM = 50.8 + 3.0


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_touches_of_a_sphere_reach_the_client(
    mosquitto: Mosquitto, tmp_path: Path
) -> None:
    bench = Workbench(tmp_path, mosquitto.host, mosquitto.port)
    bench.write_simulator(SPHERE.format(points=400))
    bench.write_daemon()
    broker = f"{mosquitto.host}:{mosquitto.port}"
    serve = ("gateway", "ippdme", "--arm-name", bench.arm, "--broker", broker)
    with bench.simulator() as simulator:
        await simulator.says("ready base")
        with (
            bench.daemon() as daemon,
            Program(
                tmp_path, "gateway", *serve, "--listen", "0", "--near", "200"
            ) as gateway,
        ):
            await gateway.says("on tcp 127.0.0.1:")
            await daemon.says("button.pressed")
            port = int(gateway.log.split("127.0.0.1:")[1].split()[0])
            async with IppClient(port, "end-to-end") as client:
                await client.ask("StartSession()")
                await client.ask("OnPtMeasReport(X(),Y(),Z(),IJK(),ER())")
                await client.ask("EnableUser()")
                for _ in range(4):
                    event = await client.until("E0000 # PtMeas(")
                    numbers = [float(n) for n in re.findall(r"-?[0-9.]+", event[15:])]
                    x, y, z, i, j, k, radius = numbers
                    off_mm = np.subtract((x, y, z), CENTRE_MM)
                    assert np.linalg.norm(off_mm) == pytest.approx(RADIUS_MM, abs=0.5)
                    assert np.linalg.norm((i, j, k)) == pytest.approx(1.0, abs=1e-5)
                    assert radius == 3.0
                answer = ["503"]
                while "503" in answer[0]:  # poses may be late on a busy computer
                    await client.ask("ClearAllErrors()")
                    answer = await client.ask("PtMeas(X(700),Y(100),Z(120))")
                assert answer[-1].startswith("X(")
                assert "IsUserEnabled(0)" in await client.ask("IsUserEnabled()")
            await gateway.says("its session is over")
            assert await gateway.stop() == 0
            assert await daemon.stop() == 0
