"""Reports on common points that determine nothing, or barely."""

from collections import Counter
from typing import Any

import numpy as np

from benchmarks.alignment.point_distributions import STD_MM, drawn_rotation
from traverse.kinematics.helmert.adjustment import HelmertError
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Box
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.nominal import fixed_volume
from traverse.lab.alignment.touches import CommonPoints, Place

VOLUME = Box(np.array([-500.0, -300.0, -200.0]), np.array([500.0, 300.0, 200.0]))
KINDS = {
    "one point": (1, (0.0, 0.0)),
    "two points": (2, (0.0, 0.0)),
    "on a line": (5, (0.0, 0.0)),
    "on a line within the errors": (5, (0.1, 0.1)),
    "nearly collinear": (5, (20.0, 20.0)),
    "coplanar": (6, (600.0, 0.0)),
    "three points": (3, (600.0, 400.0)),
    "mirrored": (6, (600.0, 400.0)),
    "wide": (6, (600.0, 400.0)),
}
NO_FLAG = "without a flag"
REFUSED = "refused"


def degenerate(n_each: int) -> dict[str, dict[str, Any]]:
    rng = np.random.default_rng(7)
    by_kind = {}
    for kind, (n, widths_mm) in KINDS.items():
        n_of_code: Counter[str] = Counter()
        example = ""
        for _ in range(n_each):
            codes, text = _refusals(rng, kind, n, widths_mm)
            n_of_code.update(codes)
            example = example or text
        by_kind[kind] = {"said": dict(n_of_code), "of": n_each, "example": example}
    return by_kind


def _refusals(
    rng: np.random.Generator, kind: str, n: int, widths_mm: tuple[float, float]
) -> tuple[list[str], str]:
    sides_mm = np.array([1000.0, *widths_mm])
    to_mm = rng.uniform(-0.5, 0.5, (n, 3)) * sides_mm @ drawn_rotation(rng).T
    true = Helmert(drawn_rotation(rng), rng.uniform(-1000.0, 1000.0, 3))
    from_mm = true.inverse().places_mm(to_mm) + rng.normal(0.0, STD_MM, (n, 3))
    if kind == "mirrored":
        from_mm[:, 1] *= -1.0
    covariance = STD_MM**2 * np.eye(3)
    common = CommonPoints(
        tuple(f"P{row}" for row in range(n)),
        tuple(Place(place, covariance) for place in from_mm),
        tuple(Place(place, 0.0 * covariance) for place in to_mm),
    )
    try:
        alignment = best_fit_alignment(common, fixed_volume(VOLUME), "drawn")
    except HelmertError as error:
        return [REFUSED], str(error)
    codes = [flag.code for flag in alignment.flags]
    texts = [flag.text for flag in alignment.flags]
    return codes or [NO_FLAG], texts[0] if texts else ""
