"""Measurements made by hand: places of the ball's centre, without any arm."""

import numpy as np

from traverse.lab.acceptance.limits import Limits, Mpe, Standards
from traverse.lab.artefacts import artefact_from_table
from traverse.lab.measured_points.measurement import ArtefactTouches, Measurement

TIP_MM = 3.0
REACH_MM = 1000.0
# Stated, as a decision needs it, and too small to matter in figures by hand.
SURE_MM = 1e-9
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])


def artefact(name, kind, **keys):
    """A table of a campaign file; standards do not expand unless they say so."""
    if kind in ("ball_bar", "points", "seats", "sphere", "parallel_planes"):
        keys = {"expansion_per_c": 0.0, "expansion_std_per_c": 1e-12, **keys}
    return artefact_from_table({"id": name, "kind": kind, **keys})


def touches(places_mm, features, temperature_c=np.nan):
    """Touches in order, all at one temperature."""
    n = len(features)
    return ArtefactTouches(
        np.array(places_mm, dtype=float),
        tuple(features),
        np.full(n, temperature_c),
        np.full(n, TIP_MM),
    )


def measured(*entries):
    """Of pairs: an artefact and its touches."""
    return Measurement(
        artefacts={entry.id: entry for entry, _ in entries},
        touched={entry.id: touched for entry, touched in entries if len(touched)},
        shoulder_mm=np.zeros(3),
        reach_mm=REACH_MM,
    )


def limits(decision="iso14253-1", standards=None, **mpe):
    return Limits(
        schema="traverse/acceptance-limits/1",
        decision=decision,
        mpe=Mpe(**mpe),
        standards=Standards(**{"form_mm": SURE_MM, **(standards or {})}),
    )


def on_a_ball(centre_mm, radius_mm, outwards):
    """Centres of the tip that touches a ball from outside."""
    return np.array(centre_mm) + (radius_mm + TIP_MM) * np.asarray(outwards)


def of_kind(parts, kind, key=None):
    """The parts of a kind; of a figure the one with that key."""
    parts_of_kind = [part for part in parts if isinstance(part, kind)]
    if key is None:
        return parts_of_kind
    (only,) = [figure for figure in parts_of_kind if figure.key == key]
    return only
