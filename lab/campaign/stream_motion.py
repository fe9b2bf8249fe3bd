"""How joints move in a stream of readings: stretches, speeds, senses of motion."""

import numpy as np

from traverse.arrays import Floats, Integers

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
    """Say the sense of the last motion, -1, +1, or 0 before any, (n, n_joints).

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
        noise_rad = _FROM_MEDIAN * _median_size(bends_rad[:, joint]) / np.sqrt(6.0)
        slowest = _RESTING * noise_rad / (usual_s * np.sqrt(2.0 * np.sum(steps**2)))
        speeds = np.nan_to_num(speeds_rad_s[:, joint])
        last = np.maximum.accumulate(np.where(np.abs(speeds) > slowest, rows, -1))
        senses[:, joint] = np.where(last >= 0, np.sign(speeds[last]), 0.0)
    return senses


def half_window(time_s: Floats) -> int:
    """Say how many samples before and after count for a speed."""
    if len(time_s) < 2:
        return _LEAST_HALF
    usual_s = float(np.median(np.diff(time_s)))
    return int(np.clip(round(_HALF_WINDOW_S / usual_s), _LEAST_HALF, _LARGEST_HALF))


def _median_size(values: Floats) -> float:
    return float(np.median(np.abs(values))) if len(values) else 0.0
