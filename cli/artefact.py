"""`traverse artefact`: a gauge to be printed, and its campaign."""

from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.options import Force, Json
from traverse.cli.common.refusals import check_target, print_report, refusals, refuse


def artefact(
    out: Annotated[Path, typer.Option("--out", "-o")],
    *,
    distance_mm: Annotated[float, typer.Option(max=1000.0)] = 50.0,
    ball_mm: Annotated[float, typer.Option(min=1.0, max=100.0)] = 6.0,
    clearance_mm: Annotated[float, typer.Option(min=0.0)] = 0.5,
    distance_std_mm: Annotated[float, typer.Option(max=100.0)] = 0.05,
    places: Annotated[int, typer.Option(min=1, max=20)] = 4,
    arm: Path | None = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a gauge to be printed, and its campaign.

    A block with two conical sockets for a ball, as STL.

    Args:
        out: Folder for gauge.stl, campaign.toml.
        distance_mm: Between the balls' centres [mm].
        ball_mm: Diameter of the ball [mm].
        clearance_mm: Gap below the ball [mm].
        distance_std_mm: Uncertainty of the distance [mm].
        places: Places in which it is touched.
        arm: Arm file: the noise of its readings is that of its encoders' counts.
    """
    if not distance_std_mm > 0.0:
        refuse(f"--distance-std-mm {distance_std_mm:g}: expected above 0 mm")
    with refusals():
        from traverse.lab.artefacts.socket_gauge import SocketGauge, rounding_rad
        from traverse.strict_toml.writing import write_atomically

        with refusals(ValueError):
            gauge = SocketGauge(distance_mm, ball_mm, clearance_mm)
        encoder_rad = None if arm is None else rounding_rad(_counts(arm))
        out.mkdir(parents=True, exist_ok=True)
        mesh, campaign = out / "gauge.stl", out / "campaign.toml"
        for path in (mesh, campaign):
            check_target(path, force=force)
        mesh.write_bytes(gauge.stl())
        write_atomically(campaign, gauge.campaign(places, distance_std_mm, encoder_rad))
    report = {
        "files": [str(mesh), str(campaign)],
        "distance_mm": distance_mm,
        "size_mm": gauge.size_mm,
        "encoder_rad": encoder_rad,
    }
    length_mm, width_mm, height_mm = gauge.size_mm
    lines = (
        f"{mesh}: {length_mm:.1f} x {width_mm:.1f} x {height_mm:.1f} mm",
        f"{campaign}: {places} places of the gauge, 2 sockets each"
        + (
            ""
            if encoder_rad is None
            else f"; readings are rounded by {1e6 * encoder_rad:.3g} µrad"
        ),
    )
    print_report(report, lines, as_json=as_json)


def _counts(path: Path) -> list[int]:
    """Read how many counts a turn of each encoder of an arm has."""
    from traverse.kinematics.arm_file.arm import read_arm

    encoders = [joint.encoder for joint in read_arm(path).joints]
    counts = [encoder.counts_per_turn for encoder in encoders if encoder is not None]
    if not counts:
        refuse(f"{path}: no joint has counts_per_turn; leave --arm out")
    return counts
