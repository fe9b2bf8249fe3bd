"""The virtual arm of a configuration: its truth, its script, its encoders."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, Encoder, read_arm
from traverse.plurals import counted
from traverse.simulator.arm.inverse import Reach
from traverse.simulator.arm.truth import EncoderSet, TrueArm, true_arm
from traverse.simulator.config import SimulatorConfig
from traverse.simulator.devices.serial_line import ON_THE_WIRE, SPEECHLESS
from traverse.simulator.devices.table import DeviceTable
from traverse.simulator.effects import (
    FaultyArm,
    effect_problems,
    faults_from_effects,
    on_true_axes,
)
from traverse.simulator.effects.faulty_arm import faulty_arm
from traverse.simulator.motions import ReplayMotion
from traverse.simulator.motions.stage import CourseBuilder, UnreachableError
from traverse.simulator.scenario.course import Course
from traverse.simulator.scenario.recorded_counts import read_recording, recorded_counts
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.wiring import CountSource, ScriptedCounts
from traverse.strict_toml.problems import FileError, Problem

LIMIT_RAD = 2.9  # of every turn, default of the configuration
WIDEST_WORD = 2**32
MOST_LEAP_RAD = 5e-3  # of a repeated recording: what a knock moves


@dataclass(frozen=True, slots=True)
class VirtualArm:
    """The simulated arm.

    ``faulty`` has all effects of the arm file; limits are (n_joints, 2), encoders in
    the order of the configuration.
    """

    truth: TrueArm
    faulty: FaultyArm
    limits_rad: np.ndarray[tuple[int, int], np.dtype[np.float64]]
    encoders: tuple[EncoderSet, ...]


def build_arm(config: SimulatorConfig, folder: Path, source: str) -> VirtualArm:
    """Make the virtual arm.

    Paths are relative to the folder; messages name ``source``.

    Raises:
        FileError: lists all inconsistencies.
    """
    nominal = read_arm(folder / config.arm.file)
    problems: list[Problem] = []
    really, true_key = nominal, "arm.file"
    if config.arm.true_file is not None:
        really, true_key = read_arm(folder / config.arm.true_file), "arm.true_file"
        if [j.name for j in really.joints] != [j.name for j in nominal.joints]:
            problems.append(
                Problem("arm.true_file", "its joints are not those of arm.file")
            )
    limits = config.arm.turn_limits_rad
    limits = (
        ((-LIMIT_RAD, LIMIT_RAD),) * len(nominal.joints) if limits is None else limits
    )
    if len(limits) != len(nominal.joints) or any(low >= high for low, high in limits):
        message = (
            f"{counted(len(limits), 'pair')} given; needs one [low, high] for each of "
            f"{counted(len(nominal.joints), 'joint')}, low below high"
        )
        problems.append(Problem("arm.turn_limits_rad", message))
    problems += effect_problems(really, true_key)
    problems += _source_problems(config.device, nominal)
    encoders = []
    if not problems:
        for number, device in enumerate(config.device):
            encoders.append(encoders_of(device, nominal, config.arm.noise_rad))
            if np.any(encoders[-1].moduli > WIDEST_WORD):
                message = (
                    f"{device.encoder_turns} turns make counts wider than 32 bits; "
                    "take fewer"
                )
                problems.append(Problem(f"device[{number}].encoder_turns", message))
        problems += _fault_problems(config, encoders)
    if problems:
        raise FileError(source, problems)
    truth = true_arm(really, config.arm.deviations, config.seed)
    effects = on_true_axes(really, really.effects, truth.mechanism.axes)
    faults = faults_from_effects(really, effects)
    return VirtualArm(
        truth,
        faulty_arm(really, truth.mechanism, truth.zeros_rad, faults),
        np.array(limits, dtype=np.float64),
        tuple(encoders),
    )


def build_script(
    config: SimulatorConfig, arm: VirtualArm, folder: Path, source: str
) -> Script:
    """Play all motions into one course.

    Paths are relative to the folder; messages name ``source``.

    Raises:
        FileError: names the motions whose targets the arm cannot reach.
    """
    stage = CourseBuilder(
        Reach(
            arm.truth.mechanism,
            arm.limits_rad,
            np.random.default_rng([config.seed, 0x6D6F]),
        ),
        arm.truth.radius_mm,
        arm.truth.switching,
        config.operator,
        folder,
        np.zeros(len(arm.limits_rad)),
    )
    start_rad = stage.posture_rad
    problems = []
    for number, motion in enumerate(config.motion):
        try:
            motion.play(stage)
        except UnreachableError as error:
            problems.append(Problem(f"motion[{number}] ({motion.kind})", str(error)))
    if problems:
        raise FileError(source, problems)
    if config.repeat and not np.array_equal(start_rad, stage.posture_rad):
        stage.move(start_rad, stage.operator.move_s)
    events = tuple(sorted(stage.events, key=lambda event: event.time_s))
    return Script(stage.trajectory(), events, config.repeat)


def build_course(config: SimulatorConfig, arm: VirtualArm, script: Script) -> Course:
    """Make the arm follow the script, by default from now on."""
    start_utc = config.start_utc or datetime.now(tz=UTC)
    return Course(script, arm.faulty, config.climate, start_utc.timestamp())


def build_sources(
    config: SimulatorConfig, arm: VirtualArm, course: Course | None, folder: Path
) -> list[CountSource]:
    """Create the source of each device's counts; without a course a replay.

    Raises:
        FileError: a recording lacks a column.
    """
    if course is not None:
        return [ScriptedCounts(course, encoders) for encoders in arm.encoders]
    first = config.motion[0]
    if not isinstance(first, ReplayMotion):
        raise ValueError(f"a {first.kind} is no replay and needs a course")
    recording = read_recording(folder / first.file)
    names = [
        [f"{device.id}/{channel}" for channel in range(len(encoders.joints))]
        for device, encoders in zip(config.device, arm.encoders, strict=True)
    ]
    missing = [n for columns in names for n in columns if n not in recording.columns]
    if missing:
        message = f"no column {', '.join(missing)}; columns are named after the "
        message += "encoders' sources in the arm file"
        raise FileError(folder / first.file, [Problem("line 1", message)])
    sources = [
        recorded_counts(recording, columns, encoders.moduli, config.repeat)
        for columns, encoders in zip(names, arm.encoders, strict=True)
    ]
    leaps = [
        f"{name} by {leap_rad:.2g} rad"
        for number, encoders in enumerate(arm.encoders)
        for name, leap_rad in zip(
            names[number], sources[number].leaps_rad(encoders), strict=True
        )
        if config.repeat and leap_rad > MOST_LEAP_RAD
    ]
    if leaps:
        message = f"the recording ends elsewhere than it begins ({', '.join(leaps)}), "
        message += "and its counts would jump; end it where it begins, or remove repeat"
        raise FileError(folder / first.file, [Problem("repeat", message)])
    return [*sources]


def _wired(device: DeviceTable, arm: Arm) -> list[tuple[int, int, Encoder]]:
    """Return channel, joint and encoder of all that a device reads."""
    wired = [
        (joint.encoder.channel, number, joint.encoder)
        for number, joint in enumerate(arm.joints)
        if joint.encoder is not None and joint.encoder.device_id == device.id
    ]
    return sorted(wired, key=lambda entry: entry[0])


def encoders_of(device: DeviceTable, arm: Arm, noise_rad: float) -> EncoderSet:
    wired = _wired(device, arm)
    per_turn = np.array([entry[2].counts_per_turn for entry in wired], dtype=np.int64)
    return EncoderSet(
        joints=np.array([entry[1] for entry in wired], dtype=np.int64),
        counts_per_turn=per_turn,
        signs=np.array([entry[2].sign for entry in wired], dtype=np.int64),
        moduli=per_turn * device.encoder_turns,
        noise_rad=noise_rad,
    )


def _source_problems(devices: Sequence[DeviceTable], arm: Arm) -> list[Problem]:
    problems = []
    ids = [device.id for device in devices]
    for joint in arm.joints:
        if joint.encoder is None:
            message = f"joint {joint.name} has no encoder; add [joints.encoder]"
            problems.append(Problem("arm.file", message))
        elif joint.encoder.device_id not in ids:
            message = (
                f"joint {joint.name} is read at '{joint.encoder.source}', but the "
                f"devices are {ids}"
            )
            problems.append(Problem("device", message))
    for number, device in enumerate(devices):
        wired = _wired(device, arm)
        channels = [channel for channel, _, _ in wired]
        if channels != list(range(len(channels))):
            message = (
                f"the arm file uses the channels {channels} of '{device.id}'; "
                "expected 0, 1, 2, ... without a gap"
            )
            problems.append(Problem(f"device[{number}].id", message))
        elif len(channels) > device.MOST_CHANNELS:
            message = (
                f"'{device.id}' has {counted(len(channels), 'encoder')} in the arm "
                "file; "
            )
            message += f"a device of kind '{device.kind}' has {device.MOST_CHANNELS}"
            problems.append(Problem(f"device[{number}].id", message))
        else:
            problems_of_device = device.channel_problems(
                [e.counts_per_turn for _, _, e in wired]
            )
            problems += [
                Problem(f"device[{number}].{key}", m) for key, m in problems_of_device
            ]
    return problems


def _fault_problems(
    config: SimulatorConfig, encoders: Sequence[EncoderSet]
) -> list[Problem]:
    problems = []
    for number, fault in enumerate(config.fault):
        concerned = [
            (device, len(encoder.joints))
            for device, encoder in zip(config.device, encoders, strict=True)
            if fault.device in {None, device.id} and fault.kind in device.FAULTS
        ]
        channel = getattr(fault, "channel", None)
        if not concerned:
            kinds = sorted(
                {d.kind for d in config.device if fault.device in {None, d.id}}
            )
            message = f"'{fault.kind}' is not played by devices of kind {kinds}"
            problems.append(Problem(f"fault[{number}].kind", message))
        elif channel is not None and channel >= (most := max(n for _, n in concerned)):
            message = f"channel {channel}, but there are {most}, counted from 0"
            problems.append(Problem(f"fault[{number}].channel", message))
        elif (
            channel is not None
            and fault.kind in ON_THE_WIRE | SPEECHLESS
            and not any(device.BY_CHANNEL for device, _ in concerned)
        ):
            message = "the device speaks for all its encoders at once; take it out"
            problems.append(Problem(f"fault[{number}].channel", message))
    return problems
