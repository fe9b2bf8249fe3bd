"""Entries of `[[effects]]`, a motion, and what effects do to a reading, by hand."""

import numpy as np

from tests.daemon.pose.test_pipeline import ZEROS
from tests.daemon.values import ARM, MODULI, UTC_OFFSET_NS

CHANNEL_TURNS = (1048576, 8388608, 65536)
N = 60
TEMPERATURE_C = 27.5  # 7.5 above the reference
# Of the first sample, at 10^12 ns monotonic; they are 10 ms apart.
FIRST_UTC = "2023-11-14T22:30:00Z"
assert UTC_OFFSET_NS + 10**12 == 1_700_001_000 * 10**9

MASSES = ARM.replace('name = "J3"', 'name = "J3"\nmass_kg = 2.5')
IDENTIFIED = '[identification]\ndate = "2023-11-14T22:30:00.3Z"\n'


def counts_of(seed=5, n=N):
    """Smooth motion of all joints, to and fro, on the board's three channels."""
    rng = np.random.default_rng(seed)
    times_s = np.arange(n)[:, np.newaxis] * 0.01
    turns = 0.1 * np.sin(rng.uniform(5, 20, 3) * times_s + rng.uniform(0, 6, 3))
    return np.rint(turns * CHANNEL_TURNS).astype(np.int64) % np.array(MODULI)


def effect(kind, **keys):
    lines = (f"{key} = {value}" for key, value in keys.items())
    return "\n".join(["[[effects]]", f'kind = "{kind}"', *lines, ""])


READINGS = {
    "encoder_eccentricity": (
        {"cos_rad": 3e-4, "sin_rad": -1e-4},
        lambda a, _: 3e-4 * np.cos(a) - 1e-4 * np.sin(a),
    ),
    "encoder_harmonic": (
        {"order": 3, "cos_rad": 3e-4, "sin_rad": -1e-4},
        lambda a, _: 3e-4 * np.cos(3 * a) - 1e-4 * np.sin(3 * a),
    ),
    "transmission_error": (
        {"cycles": 80.5, "cos_rad": 3e-4, "sin_rad": -1e-4},
        lambda a, _: 3e-4 * np.cos(80.5 * a) - 1e-4 * np.sin(80.5 * a),
    ),
    "encoder_scale": ({"scale_ppm": 200.0}, lambda a, _: 2e-4 * (a - ZEROS[1])),
    "encoder_temperature": ({"rate_rad_c": 1e-4}, lambda a, _: 7.5e-4 + 0 * a),
    "encoder_drift": (
        {"rate_rad_s": 1e-3, "epoch_utc": FIRST_UTC},
        lambda _, t: 1e-3 * np.minimum(t, 0.3),  # held beyond the campaign
    ),
    "count_slip": (
        {"at_s": 0.25, "step_rad": 1e-3, "epoch_utc": FIRST_UTC},
        lambda _, t: 1e-3 * (t > 0.245),
    ),
    "encoder_latency": (
        {"latency_s": 2e-3},
        lambda a, _: -2e-3 * np.diff(a, prepend=a[0]) / 0.01,
    ),
    "backlash": (
        {"half_width_rad": 4e-4},
        lambda a, _: 4e-4 * np.sign(np.diff(a, prepend=a[0])),
    ),
}


OF_POSTURE = {
    "joint_compliance": {"joint": '"J2"', "compliance_rad_nm": 1e-4},
    "bearing_compliance": {"joint": '"J2"', "compliance_rad_nm": 1e-4},
    "mount_compliance": {"compliance_rad_nm": 1e-4},
    "axis_wobble": {
        "joint": '"J2"',
        "order": 2,
        "cos_rad": [1e-4, 0.0, 0.0],
        "sin_rad": [0.0, 0.0, 1e-4],
    },
    "axis_runout": {
        "joint": '"J2"',
        "component": '"axial"',
        "order": 1,
        "cos_mm": [0.0, 0.01, 0.0],
        "sin_mm": [0.0, 0.01, 0.0],
    },
}


CONTACTS = {
    "probe_radius": {"radius_error_mm": 0.1},
    "probe_lobing": {"amplitude_mm": 0.1, "phase_rad": 0.0},
    "stylus_bending": {"compliance_mm_n": 0.1},
}


def everything():
    entries = [
        effect(kind, joint='"J2"', **keys) for kind, (keys, _) in READINGS.items()
    ]
    entries += [effect(kind, **keys) for kind, keys in (OF_POSTURE | CONTACTS).items()]
    curve = {"knots": [-1.0, 0.0, 1.0], "values_rad": [0.0, 1e-4, 0.0]}
    entries += [
        effect("thermal_expansion", expansion_per_c=2e-5),
        effect("empirical", joint='"J3"', covariate='"J2_speed_rad_s"', **curve),
    ]
    return "".join(entries)
