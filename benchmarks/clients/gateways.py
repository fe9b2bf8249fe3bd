"""`python -m benchmarks.clients.gateways FOLDER`: pictures of gateways for docs/.

A real broker and a simulated arm with its daemon. typed-points.png: `traverse gateway
keys`, an X server and xterm with a program that takes text. live-view.png: what a
viewer receives of `traverse gateway live`, drawn by matplotlib.
"""

import asyncio
import contextlib
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.image import imsave

from benchmarks.clients.screenshots import simulated
from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from tests.client.gateways.desktop import SIZE, desktop
from tests.client.gateways.foxglove_viewer import Viewer
from traverse.client import Arm
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.model.quaternion import rotation_matrix
from traverse.recording.views import bytes_to_cloud

DEMO = Path(__file__).parent.parent.parent / "cli" / "demo_data"
RUN = (sys.executable, "-m", "traverse", "gateway")
POINTS, MAGNIFIED, LONGEST_S = 8, 500, 120.0


async def confirmed(broker: str) -> None:
    async with Arm("demo-7", broker) as arm:
        await arm.confirm_reference()


def typed(folder: Path, options: tuple[str, ...], out: Path) -> None:
    with desktop(folder) as shown:
        os.environ["DISPLAY"] = shown.name
        with rig.program(folder / "keys.log", *RUN, "keys", *options):
            rig.wait_for(
                lambda: shown.typed.count("\n") >= POINTS, "typed points", LONGEST_S
            )
        width, height = SIZE
        pixels = np.frombuffer(shown.picture(), np.uint8).reshape(height, width, 4)
        imsave(out / "typed-points.png", np.ascontiguousarray(pixels[:, :, 2::-1]))


async def live(folder: Path, broker: str, options: tuple[str, ...], out: Path) -> None:
    """Measure and scan until a viewer has seen enough."""
    port = rig.free_port()
    live_options = ("--listen", str(port), "--magnify", str(MAGNIFIED))
    with rig.program(folder / "live.log", *RUN, "live", *options, *live_options):
        rig.wait_for(lambda: rig.listens(port), "the server")
        async with (
            Viewer(f"ws://127.0.0.1:{port}") as viewer,
            Arm("demo-7", broker) as arm,
            arm.scan("time", rate_hz=50.0),
            asyncio.timeout(LONGEST_S),
        ):
            while len(viewer.messages.get("points", ())) < 5 * POINTS:  # noqa: ASYNC110
                await asyncio.sleep(0.1)
        draw(viewer.messages, out / "live-view.png")


def draw(messages: dict[str, list[Any]], path: Path) -> None:
    """Draw the received primitives: all of them, and some points near by."""
    entities = [drawn for up in messages["points"] for drawn in up.get("entities", ())]
    entities.append(messages["arm"][-1]["entities"][0])
    clouds = [
        bytes_to_cloud(json.dumps(message).encode()).points
        for message in messages["cloud"]
    ]
    centre = xyz(entities[POINTS]["spheres"][0]["pose"]["position"])
    figure = plt.figure(figsize=(11, 5), layout="constrained")
    for place, half_m in ((121, None), (122, 0.03)):
        axes = figure.add_subplot(place, projection="3d")
        for entity in entities:
            draw_entity(axes, entity, centre, half_m)
        if half_m is None:
            for points in clouds:
                place_m = (points[axis] for axis in "xyz")
                axes.plot(*place_m, ".", color="grey", markersize=1)
        axes.set(xlabel="x / m", ylabel="y / m", zlabel="z / m", aspect="equal")
    figure.suptitle(
        "What a viewer receives, drawn by matplotlib (not Foxglove's own picture): arm,"
        " points, scan; right: points near by.\n"
        f"Ellipsoids of k = 2, {MAGNIFIED} times as large.",
        fontsize=10,
    )
    figure.savefig(path, dpi=90)


def draw_entity(
    axes: Any,  # noqa: ANN401 - matplotlib has no types
    entity: dict[str, Any],
    centre: list[float],
    half_m: float | None,
) -> None:
    for line in entity.get("lines", ()):
        ends = np.array([xyz(end) for end in line["points"]])
        if half_m is not None and np.abs(ends - centre).max() > half_m:
            return
        pieces = [ends] if line.get("type") is None else ends.reshape(-1, 2, 3)
        for piece in pieces:
            axes.plot(*piece.T, color=rgba(line["color"]), linewidth=1)
    for sphere in entity.get("spheres", ()):
        axes.plot_surface(*surface(sphere), color=rgba(sphere["color"]))


def xyz(table: dict[str, float]) -> list[float]:
    """Read a vector; absent components are 0."""
    return [table.get(axis, 0.0) for axis in "xyz"]


def rgba(table: dict[str, float]) -> tuple[float, ...]:
    return tuple(table.get(channel, 0.0) for channel in "rgba")


def surface(sphere: dict[str, Any]) -> np.ndarray:
    """Points of an ellipsoid, (3, n, m) in metres."""
    u, v = np.mgrid[0 : 2 * np.pi : 13j, 0 : np.pi : 7j]
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    pose = sphere["pose"]
    turn = rotation_matrix(
        np.array([pose["orientation"].get("w", 0.0), *xyz(pose["orientation"])])
    )
    half = np.array(xyz(sphere["size"])) / 2
    centre = np.array(xyz(pose["position"]))[:, None, None]
    drawn: np.ndarray = np.einsum("ij,jkl->ikl", turn * half, ball) + centre
    return drawn


def take_pictures(folder: Path, out: Path) -> None:
    port = rig.free_port()
    broker = f"127.0.0.1:{port}"
    for name in ("arm.toml", "arm.cov.npz"):
        shutil.copy(DEMO / name, folder)
    options = ("--arm-name", "demo-7", "--broker", broker)
    identified = read_arm(DEMO / "identified.toml")
    with (
        rig.mosquitto(folder, port),
        simulated(folder),
        rig.daemon(folder, port, arm=identified),
    ):
        asyncio.run(confirmed(broker))
        typed(folder, options, out)
        asyncio.run(live(folder, broker, options, out))


def main(folder: Path) -> None:
    out = folder.resolve()
    with tempfile.TemporaryDirectory() as temporary, contextlib.chdir(temporary):
        take_pictures(Path(), out)


if __name__ == "__main__":
    run_main(main)
