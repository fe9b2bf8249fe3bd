"""`traverse joints`: the conversation."""

import asyncio
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import FAILED, refuse

if TYPE_CHECKING:
    from traverse.cli.joints.devices import TurningDevices
    from traverse.daemon.config.devices import DeviceSection
    from traverse.drivers.turning import Turned
    from traverse.kinematics.arm_file.arm import Arm, Joint

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

    configuration = read_configuration(config)
    arm_file = config.parent / configuration.arm.file
    arm = read_arm(arm_file)
    turned = asyncio.run(_converse(configuration.device, arm, angle, as_json))
    with_encoders = _arm_with(arm, turned)
    written = with_encoders != arm and not dry_run
    if written:
        write_arm(arm_file, with_encoders)
    missing = [joint.name for joint in arm.joints if joint.name not in turned]
    _print(
        {"event": "end", "written": str(arm_file) if written else None},
        f"written: {arm_file}" if written else f"{arm_file} stays as it is",
        as_json,
    )
    if missing:
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
) -> dict[str, "Turned"]:
    """Ask for one joint after the other; return the findings by joint."""
    from traverse.cli.joints.devices import turning_devices, typed_lines
    from traverse.drivers.turning import turned_joint

    turned: dict[str, Turned] = {}
    async with turning_devices(sections) as devices:
        await devices.connected()
        _print(
            {"event": "rest"}, "Let the arm rest, and wait for a moment ...", as_json
        )
        await devices.rested()
        noise_counts = _print_rest(devices, as_json)
        lines = typed_lines()
        for joint in arm.joints:
            while True:
                devices.begin()
                _print(
                    {"event": "turn", "joint": joint.name},
                    _prompt(joint, angle_deg),
                    as_json,
                )
                typed = await lines.get()
                if typed == "":
                    refuse("standard input has ended before all joints were turned")
                if typed.strip() in (LEAVE_OUT, END):
                    break
                await devices.settled()
                expected = joint.encoder.counts_per_turn if joint.encoder else None
                outcome = turned_joint(
                    devices.tracks, noise_counts, angle_deg / 360.0, expected
                )
                if not isinstance(outcome, str):
                    outcome = _checked(outcome, turned)
                if isinstance(outcome, str):
                    _print(
                        {"event": "again", "joint": joint.name, "reason": outcome},
                        f"{joint.name}: {outcome}; once more",
                        as_json,
                    )
                    continue
                turned[joint.name] = outcome
                _print(
                    {"event": "found", "joint": joint.name, **asdict(outcome)},
                    _sentence(joint, outcome),
                    as_json,
                )
                break
            if typed.strip() == END:
                break
    return turned


def _checked(outcome: "Turned", turned: Mapping[str, "Turned"]) -> "Turned | str":
    """Refuse a channel that another joint has, and counts that fit no turn."""
    for name, other in turned.items():
        if other.source == outcome.source:
            return f"{outcome.source} is {name}'s encoder already"
    if outcome.counts_per_turn is None:
        return (
            f"{outcome.source} moved by {outcome.moved_counts} counts, which fits no "
            "counts per turn of the device; turn it by the angle, or write "
            "counts_per_turn into the arm file first"
        )
    return outcome


def _print_rest(devices: "TurningDevices", as_json: bool) -> dict[str, int]:
    """Print the noise of the channels at rest; return the range of each."""
    noise_counts = {}
    for track in devices.tracks:
        noise = track.highest_counts - track.lowest_counts
        noise_counts[track.source] = noise
        alarm = devices.alarms.get(track.source, "")
        words = [f"{track.source}: {track.modulus_counts} counts, moves by {noise}"]
        for n, what in (
            (track.n_invalid, "without a valid count"),
            (track.n_weak, "with a weak signal"),
        ):
            if n:
                words.append(f"{n / track.n_samples:.0%} of samples {what}")
        if alarm:
            words.append(alarm)
        _print(
            {
                "event": "channel",
                "source": track.source,
                "modulus_counts": track.modulus_counts,
                "noise_counts": noise,
                "n_samples": track.n_samples,
                "n_invalid": track.n_invalid,
                "n_weak": track.n_weak,
                "alarm": alarm,
            },
            "; ".join(words),
            as_json,
        )
    return noise_counts


def _prompt(joint: "Joint", angle_deg: float) -> str:
    axis = " ".join(f"{component:g}" for component in joint.axis)
    return (
        f"{joint.name}: turn it alone by about {angle_deg:g} degrees, right-handed "
        f"about its axis ({axis}); then Enter ({LEAVE_OUT}: leave it out, {END}: end)"
    )


def _sentence(joint: "Joint", outcome: "Turned") -> str:
    """What was found, beside what the arm file says."""
    degrees = 360.0 * (outcome.angle_turns or 0.0)
    text = (
        f"{joint.name}: {outcome.source}, sign {outcome.sign:+d}, "
        f"{outcome.counts_per_turn} counts per turn; it turned by {degrees:.1f} degrees"
    )
    before = joint.encoder
    if before is None:
        return text
    values = (before.source, before.sign, before.counts_per_turn)
    if values == (outcome.source, outcome.sign, outcome.counts_per_turn):
        return f"{text}: as in the arm file"
    return f"{text}; the arm file had {before.source}, {before.sign:+d}, {values[2]}"


def _arm_with(arm: "Arm", turned: Mapping[str, "Turned"]) -> "Arm":
    """The arm with the encoders that were found."""
    from traverse.kinematics.arm_file.arm import Encoder

    made = []
    for joint in arm.joints:
        outcome = turned.get(joint.name)
        if outcome is None:
            made.append(joint)
            continue
        values = {
            "source": outcome.source,
            "sign": outcome.sign,
            "counts_per_turn": outcome.counts_per_turn,
        }
        encoder = (
            Encoder.model_validate(values)
            if joint.encoder is None
            else joint.encoder.model_copy(update=values)
        )
        is_same = encoder == joint.encoder
        made.append(joint if is_same else joint.model_copy(update={"encoder": encoder}))
    return arm.model_copy(update={"joints": tuple(made)})


def _print(values: dict[str, object], text: str, as_json: bool) -> None:
    typer.echo(json.dumps(values) if as_json else text)
