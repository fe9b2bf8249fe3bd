"""Features from samples of scans, whose errors hang together.

A hand presses with a force of its own in each scan, and what a contact adds besides
changes within some 0.1 s; the encoders' noise is new in each sample.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.kinematics.features.parts import TIP_MM, Part, reaching, ring, touched
from tests.kinematics.features.test_features import touches_of
from tests.kinematics.uncertainty.test_joint_covariance import CONTACT_MM, bench
from tests.kinematics.uncertainty.test_point_covariance import (
    arm,
    effects,
    geometry,
    postures,
)
from traverse.kinematics.features.figures import distance, figures_of
from traverse.kinematics.features.measured import Definition, measured_features

__all__ = ["arm", "bench", "effects", "geometry"]  # fixtures

PARTS, SAMPLES, SAMPLE_S, CORRELATED_S = 20, 30, 0.08, 0.1
TRUTH = {
    **{"bore diameter": 20.0, "hole diameter": 12.0, "shaft diameter": 25.0},
    "bore to hole": 50.0,
}
TIMES_NS = np.arange(SAMPLES) * round(SAMPLE_S * 1e9)


def scanned_part(at_mm) -> Part:
    """Two holes and a shaft, each scanned once."""
    turns = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    pieces = {}
    for name, x_mm in (("bore", -25.0), ("hole", 25.0)):
        radius_mm = TRUTH[f"{name} diameter"] / 2 - TIP_MM
        centres_mm, out = ring(SAMPLES, radius_mm, np.full(SAMPLES, -4.0))
        pieces[name] = centres_mm + np.array([x_mm, 0.0, 0.0]), out
    out = np.column_stack([np.cos(3 * turns), np.sin(3 * turns), 0 * turns])
    up = np.outer(turns, [0.0, 0.0, 4.0])
    pieces["shaft"] = (TRUTH["shaft diameter"] / 2 + TIP_MM) * out + up, -out
    definitions = [
        Definition(
            name,
            "cylinder" if name == "shaft" else "circle",
            tuple(range(SAMPLES * number, SAMPLES * (number + 1))),
            "outside" if name == "shaft" else "inside",
        )
        for number, name in enumerate(pieces)
    ]
    centres, towards = (
        np.concatenate(each) for each in zip(*pieces.values(), strict=True)
    )
    return Part(definitions, centres + at_mm, towards, TRUTH)


def contacts_mm(part, rng):
    """Errors of contacts: a force of each scan, and what changes along it."""
    n = len(part.centres_mm)
    kept = np.exp(-SAMPLE_S / CORRELATED_S)
    changing = rng.normal(size=(n, 3))
    for row in range(1, n):
        changing[row] = kept * changing[row - 1] + np.sqrt(1 - kept**2) * changing[row]
    pressed = np.repeat(rng.normal(size=n // SAMPLES), SAMPLES)
    return CONTACT_MM * (changing + pressed[:, np.newaxis] * part.towards)


def figures(features):
    elements, errors = features.elements, features.errors
    named = {
        f"{name} {figure.name}": figure
        for name, element in elements.items()
        for figure in figures_of(element, errors)
    }
    apart = distance(elements["bore"], elements["hole"], errors)
    return {"bore to hole": apart, **named}


def test_figures_of_20_scanned_parts_lie_within_their_uncertainty(bench):
    """Strategy: k = 2 holds 95 %; of as independent samples U would be too small."""
    rng = np.random.default_rng(12)
    start_rad = postures(bench.geometry, 1, 5)
    part = scanned_part(bench.measured(start_rad, None)[0])
    n = len(part.centres_mm)
    nominal_rad = reaching(
        lambda angles_rad: bench.measured(angles_rad, None),
        np.tile(start_rad, (n, 1)),
        part.centres_mm,
    )
    scans = np.repeat(np.arange(n // SAMPLES), SAMPLES)
    ratios, single_ratios = {}, {}
    for _ in range(PARTS):
        touches = touched(bench, part, nominal_rad, rng, contacts_mm(part, rng))
        of_scans = replace(
            touches, scans=scans, times_ns=np.tile(TIMES_NS, n // SAMPLES)
        )
        for each, kept in ((of_scans, ratios), (touches, single_ratios)):
            named = figures(measured_features(part.definitions, each))
            for name, truth in TRUTH.items():
                ratio = (named[name].value - truth) / named[name].std
                kept.setdefault(name, []).append(abs(ratio))
    inside = {name: np.mean(np.array(each) <= 2.0) for name, each in ratios.items()}
    assert inside.keys() == TRUTH.keys()
    assert min(inside.values()) >= 0.85, inside
    assert np.mean(list(inside.values())) >= 0.95, inside
    as_independent = [np.mean(np.array(each) <= 2.0) for each in single_ratios.values()]
    assert np.mean(as_independent) < np.mean(list(inside.values())), as_independent
    sizes = {name: np.sqrt(np.mean(np.square(each))) for name, each in ratios.items()}
    assert np.mean(list(sizes.values())) > 0.4, sizes


def test_samples_of_a_wave_count_as_often_as_it_turns():
    """Three lobes of 120 samples are some ten values, and of the form each counts."""
    turns = 2.0 * np.pi * np.arange(120) / 120
    radii_mm = 10.0 + 0.05 * np.cos(3 * turns)
    circle = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    touches = touches_of(radii_mm[:, np.newaxis] * circle, std_mm=0.001)
    hole = [Definition("hole", "circle", tuple(range(120)), "inside")]
    times_ns = np.arange(120) * 1_000_000_000
    of_scan = replace(touches, scans=np.zeros(120, np.int64), times_ns=times_ns)
    of_touches, of_samples = (
        {figure.name: figure for figure in figures_of(f.elements["hole"], f.errors)}
        for f in (measured_features(hole, each) for each in (touches, of_scan))
    )
    wave_std_mm = 0.05 / np.sqrt(2.0)
    at_once = 2.0 * wave_std_mm / np.sqrt(120)
    assert of_touches["diameter"].std == pytest.approx(at_once, rel=0.05)
    pressed_mm = 2.0 * 0.001  # alike all along
    expected = np.hypot(pressed_mm, at_once * np.sqrt(12))
    assert of_samples["diameter"].std == pytest.approx(expected, rel=0.1)
    assert of_samples["x"].std == pytest.approx(
        of_touches["x"].std * np.sqrt(12), rel=0.3
    )
    assert of_samples["form"].std == pytest.approx(of_touches["form"].std, rel=1e-6)
