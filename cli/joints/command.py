"""`traverse joints`: the conversation."""

import asyncio
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import FAILED, refusals, refuse

if TYPE_CHECKING:
    from traverse.cli.joints.devices import TurningDevices
    from traverse.cli.joints.search import JointSearch
    from traverse.daemon.config.devices import DeviceSection
    from traverse.kinematics.arm_file.arm import Arm

LEAVE_OUT, END = "s", "q"


def joints(
    config: Path,
    *,
    angle: Annotated[float, typer.Option(min=10.0, max=360.0)] = 90.0,
    dry_run: bool = False,
    as_json: Json = False,
) -> None:
    """Find each joint's encoder by turning it, and write them into the arm file.

    Turn one joint after the other, base outwards, as it is prompted for, and press
    Enter: channel, sign and counts per turn are found or confirmed. The arm file may
    lack its encoder tables. The daemon must not be running. Exit status 1: not all
    joints were found; 3: a device could not be reached.

    Args:
        config: The daemon's configuration, which names devices and arm file.
        angle: About how far each joint is turned, in degrees.
        dry_run: Leave the arm file as it is.
        as_json: Print a JSON line for each finding.
    """
    from traverse.daemon.config.schema import read_configuration
    from traverse.kinematics.arm_file.arm import read_arm, write_arm

    with refusals():
        configuration = read_configuration(config)
        arm_file = config.parent / configuration.arm.file
        arm = read_arm(arm_file)
    search = asyncio.run(_converse(configuration.device, arm, angle, as_json))
    with_encoders = search.arm_with_encoders()
    written = with_encoders != arm and not dry_run
    if written:
        with refusals():
            write_arm(arm_file, with_encoders)
    _print(
        {"event": "end", "written": str(arm_file) if written else None},
        f"written: {arm_file}" if written else f"{arm_file} stays as it is",
        as_json,
    )
    if missing := search.missing:
        _print(
            {"event": "not_found", "joints": missing},
            f"not found: {', '.join(missing)}",
            as_json,
        )
        raise typer.Exit(FAILED)


async def _converse(
    sections: "Sequence[DeviceSection]",
    arm: "Arm",
    angle_deg: float,
    as_json: bool,
) -> "JointSearch":
    from traverse.cli.joints.devices import turning_devices, typed_lines
    from traverse.cli.joints.search import JointSearch, encoder_sentence

    async with turning_devices(sections) as devices:
        search = JointSearch(devices, arm, angle_deg)
        _print(
            {"event": "rest"}, "Let the arm rest, and wait for a moment ...", as_json
        )
        await search.rest()
        _print_rest(devices, search, as_json)
        lines = typed_lines()
        for joint in arm.joints:
            while True:
                search.begin()
                _print(
                    {"event": "turn", "joint": joint.name},
                    f"{search.prompt(joint)}; then Enter ({LEAVE_OUT}: leave it out, "
                    f"{END}: end)",
                    as_json,
                )
                typed = await lines.get()
                if typed == "":
                    refuse("standard input has ended before all joints were turned")
                if typed.strip() in (LEAVE_OUT, END):
                    break
                outcome = await search.take(joint)
                if isinstance(outcome, str):
                    _print(
                        {"event": "again", "joint": joint.name, "reason": outcome},
                        f"{joint.name}: {outcome}; once more",
                        as_json,
                    )
                    continue
                _print(
                    {"event": "found", "joint": joint.name, **asdict(outcome)},
                    encoder_sentence(joint, outcome),
                    as_json,
                )
                break
            if typed.strip() == END:
                break
    return search


def _print_rest(
    devices: "TurningDevices", search: "JointSearch", as_json: bool
) -> None:
    from traverse.cli.joints.search import channel_sentence

    for track in devices.tracks:
        noise_counts = search.noise_counts[track.source]
        alarm = devices.alarms.get(track.source, "")
        _print(
            {
                "event": "channel",
                "source": track.source,
                "modulus_counts": track.modulus_counts,
                "noise_counts": noise_counts,
                "n_samples": track.n_samples,
                "n_invalid": track.n_invalid,
                "n_weak": track.n_weak,
                "alarm": alarm,
            },
            channel_sentence(track, noise_counts, alarm),
            as_json,
        )


def _print(values: dict[str, object], text: str, as_json: bool) -> None:
    typer.echo(json.dumps(values) if as_json else text)
