"""Poses out of a recorded stream: every sample in which something is touched is one.

Counts become readings by the encoders of the arm file in the recording: the first
sample takes the turn nearest zero_rad, then counts are unwrapped. Speeds and senses
of motion use the readings around each sample; a sample at the end of a stretch,
which has none, is no pose.
"""

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm, parse_arm
from traverse.kinematics.model.readings import (
    Unwrapper,
    counts_to_angles,
    encoders_from_arm,
)
from traverse.lab.campaign.pose_table import PoseTable
from traverse.lab.campaign.poses import Poses
from traverse.plurals import counted
from traverse.recording.reader import read_recording
from traverse.recording.values import Recording
from traverse.strict_toml.problems import FileError, Problem, unknown_name_message

# A longer step of time than this many usual ones is a gap.
_GAP = 1.5
# Speeds are slopes of a line through the readings this long before and after.
_HALF_WINDOW_S = 0.02
_LEAST_HALF, _LARGEST_HALF = 2, 25
# Slower than this many standard deviations of a speed: it may as well rest.
_RESTING = 5.0
# Of normal numbers: standard deviation over median absolute value.
_FROM_MEDIAN = 1.4826


def stretches_of(time_s: Floats) -> Integers:
    """Number the stretches without a gap, (n,), from 0 on.

    Args:
        time_s: Rising, (n,).
    """
    steps_s = np.diff(time_s)
    if len(steps_s) == 0:
        return np.zeros(len(time_s), dtype=np.int64)
    gaps = steps_s > _GAP * float(np.median(steps_s))
    return np.concatenate([[0], np.cumsum(gaps)]).astype(np.int64)


def speeds_of(time_s: Floats, angles_rad: Floats, stretches: Integers) -> Floats:
    """Compute d(alpha)/dt.

    The slope at sample i of a line through the w samples before and after it,

        sum of k (alpha_(i+k) - alpha_(i-k)) / sum of k (t_(i+k) - t_(i-k))

    Args:
        time_s: (n,).
        angles_rad: (n, n_joints).
        stretches: As from `stretches_of`, (n,).

    Returns:
        (n, n_joints) [rad/s]; NaN nearer than w samples to the end of a stretch.
    """
    half = half_window(time_s)
    n = len(time_s)
    speeds = np.full_like(angles_rad, np.nan)
    if n <= 2 * half:
        return speeds
    rises = np.zeros((n - 2 * half, angles_rad.shape[1]))
    runs_s = np.zeros(n - 2 * half)
    for k in range(1, half + 1):
        later, earlier = slice(half + k, n - half + k), slice(half - k, n - half - k)
        rises += k * (angles_rad[later] - angles_rad[earlier])
        runs_s += k * (time_s[later] - time_s[earlier])
    inside = stretches[2 * half :] == stretches[: n - 2 * half]
    speeds[half : n - half][inside] = rises[inside] / runs_s[inside, np.newaxis]
    return speeds


def senses_of(time_s: Floats, angles_rad: Floats, speeds_rad_s: Floats) -> Floats:
    """Return the sense of the last motion, -1, +1, or 0 before any, (n, n_joints).

    A joint that is slower than what its readings' noise looks like keeps its sense.

    Args:
        time_s: (n,).
        angles_rad: (n, n_joints).
        speeds_rad_s: Of them, (n, n_joints).
    """
    half = half_window(time_s)
    steps = np.arange(1, half + 1)
    usual_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    bends_rad = np.diff(angles_rad, 2, axis=0) if len(time_s) > 2 else angles_rad[:0]
    senses = np.zeros_like(angles_rad)
    rows = np.arange(len(time_s))
    for joint in range(angles_rad.shape[1]):
        bends = np.abs(bends_rad[:, joint])
        usual_bend_rad = float(np.median(bends)) if len(bends) else 0.0
        noise_rad = _FROM_MEDIAN * usual_bend_rad / np.sqrt(6.0)
        slowest = _RESTING * noise_rad / (usual_s * np.sqrt(2.0 * np.sum(steps**2)))
        speeds = np.nan_to_num(speeds_rad_s[:, joint])
        last = np.maximum.accumulate(np.where(np.abs(speeds) > slowest, rows, -1))
        senses[:, joint] = np.where(last >= 0, np.sign(speeds[last]), 0.0)
    return senses


def half_window(time_s: Floats) -> int:
    """Return how many samples before and after count for a speed."""
    if len(time_s) < 2:
        return _LEAST_HALF
    usual_s = float(np.median(np.diff(time_s)))
    return int(np.clip(round(_HALF_WINDOW_S / usual_s), _LEAST_HALF, _LARGEST_HALF))


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_LONG_GAP_S = 0.5


def read_stream_table(
    path: Path,
    joint_names: Sequence[str],
    features: Mapping[str, tuple[str, ...]],
    start_utc: datetime | None,
) -> PoseTable:
    """Read the poses of a recording.

    Args:
        path: The MCAP file.
        joint_names: Of the arm, in order.
        features: The features that each artefact has, by its id; none: any.
        start_utc: From where time_s counts; None: from the first sample.

    Raises:
        FileError: Everything in the recording that does not fit.
    """
    recording = read_recording(path)
    problems = list(_problems(recording, joint_names, features))
    if problems:
        raise FileError(path, problems)
    samples = recording.samples
    arm = parse_arm(recording.arm_text)
    encoders = encoders_from_arm(arm)
    angles_rad = counts_to_angles(encoders, Unwrapper(encoders).unwrap(samples.counts))
    first_utc = _EPOCH + timedelta(microseconds=int(samples.utc_ns[0]) // 1000)
    start_utc = start_utc or first_utc
    since_s = 1e-9 * (samples.sample_time_ns - samples.sample_time_ns[0])
    stretches = stretches_of(since_s)
    speeds_rad_s = speeds_of(since_s, angles_rad, stretches)
    senses = senses_of(since_s, angles_rad, speeds_rad_s)
    artefacts, feature_indices, free = _touched(recording, features)
    poses = np.flatnonzero((artefacts >= 0) & np.isfinite(speeds_rad_s[:, 0]))
    if len(poses) == 0:
        message = "nothing is touched in any sample; see the channel `touching`"
        raise FileError(path, message)
    conditions = _conditions(recording)
    samples_of_all = Poses(
        lines=np.arange(1, len(since_s) + 1),
        time_s=since_s + (first_utc - start_utc).total_seconds(),
        artefacts=artefacts,
        features=feature_indices,
        angles_rad=angles_rad,
        approaches=senses,
        speeds_rad_s=speeds_rad_s,
        temperature_c=conditions.get("temperature_c"),
        force_n=conditions.get("force_n"),
    )
    notes = tuple(_notes(recording, since_s))
    return PoseTable(samples_of_all.part(poses), free, start_utc, notes)


def _problems(
    recording: Recording,
    joint_names: Sequence[str],
    features: Mapping[str, tuple[str, ...]],
) -> Iterator[Problem]:
    expected = tuple(joint_names)
    if recording.joints != expected:
        yield Problem("", _other_joints(recording.joints, expected))
    try:
        arm = parse_arm(recording.arm_text)
    except FileError as error:
        for problem in error.problems:
            yield Problem(f"arm.toml {problem.where}".strip(), problem.message)
    else:
        yield from _arm_problems(recording, arm)
    if all(touching.artefact is None for touching in recording.touching):
        yield Problem("touching", "names no artefact; say what is touched, and when")
    for name in dict.fromkeys(t.artefact for t in recording.touching):
        if name is not None and name not in features:
            yield Problem("touching", unknown_name_message("artefact", name, features))
    pairs = dict.fromkeys((t.artefact, t.feature) for t in recording.touching)
    for artefact, feature in pairs:
        known = features.get(artefact or "", ())
        if known and feature not in known:
            message = unknown_name_message("feature", feature, known)
            yield Problem("touching", f"{message} ({artefact})")


def _arm_problems(recording: Recording, arm: Arm) -> Iterator[Problem]:
    names = tuple(joint.name for joint in arm.joints)
    if names != recording.joints:
        yield Problem("arm.toml", _other_joints(names, recording.joints))
        return
    try:
        per_turn = encoders_from_arm(arm).counts_per_turn
    except ValueError as error:
        yield Problem("arm.toml", str(error))
        return
    largest = recording.samples.counts.max(axis=0).astype(np.int64)
    for name, most, of_turn in zip(
        names, largest.tolist(), per_turn.tolist(), strict=True
    ):
        if most >= of_turn:
            message = f"{name} has counts up to {most}, expected less than {of_turn}"
            yield Problem("samples", f"{message}, its counts_per_turn")


def _other_joints(recorded: Sequence[str], expected: Sequence[str]) -> str:
    return f"has the joints {', '.join(recorded)}; expected {', '.join(expected)}"


def _touched(
    recording: Recording, features: Mapping[str, tuple[str, ...]]
) -> tuple[Integers, Integers, tuple[str, ...]]:
    """Return what each sample touches: artefact (-1: none) and feature, (n,) each."""
    times_ns = recording.samples.sample_time_ns
    numbers = {name: number for number, name in enumerate(features)}
    free: dict[str, int] = {}
    artefacts = np.full(len(times_ns), -1, dtype=np.int64)
    indices = np.zeros(len(times_ns), dtype=np.int64)
    starts_ns = [touching.sample_time_ns for touching in recording.touching]
    ends = [*np.searchsorted(times_ns, starts_ns[1:]).tolist(), len(times_ns)]
    starts = np.searchsorted(times_ns, starts_ns).tolist()
    for touching, first, end in zip(recording.touching, starts, ends, strict=True):
        if touching.artefact is None:
            artefacts[first:end] = -1
            continue
        artefacts[first:end] = numbers[touching.artefact]
        known = features[touching.artefact]
        if known:
            indices[first:end] = known.index(touching.feature)
        else:
            indices[first:end] = free.setdefault(touching.feature, len(free))
    return artefacts, indices, tuple(free)


def _conditions(recording: Recording) -> dict[str, Floats]:
    """Interpolate what was measured now and then, by column, (n,) each."""
    times_ns = recording.samples.sample_time_ns
    columns: dict[str, Floats] = {}
    for name in ("temperature_c", "force_n"):
        known = [
            (float(condition.sample_time_ns - times_ns[0]), value)
            for condition in recording.conditions
            if (value := getattr(condition, name)) is not None
        ]
        if known:
            at_ns, values = np.array(known).T
            columns[name] = np.interp(times_ns - times_ns[0], at_ns, values)
    return columns


def _notes(recording: Recording, since_s: Floats) -> Iterator[str]:
    """Yield what is not as it should be, but no reason to refuse."""
    if recording.tear is not None:
        n = len(recording.samples)
        yield f"{recording.tear}; what is used before that: {counted(n, 'sample')}"
    gaps_s = np.diff(since_s)
    n_long = int(np.count_nonzero(gaps_s > _LONG_GAP_S))
    if n_long:
        yield (
            f"{counted(n_long, 'gap')} of more than {_LONG_GAP_S} s, the longest "
            f"{float(gaps_s.max()):.3g} s: a joint that turned by half a turn "
            "meanwhile is taken to be a turn off"
        )
