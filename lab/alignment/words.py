"""An alignment in words: lines for a terminal, which the page repeats."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

METHODS = {
    "best-fit": "best fit of points",
    "3-2-1": "3-2-1: plane, line, point",
    "leapfrog": "leapfrog: the second station in the system of the first",
}


def alignment_lines(values: Mapping[str, Any]) -> Iterator[str]:
    """Say an alignment in lines.

    Args:
        values: As in alignment.json.
    """
    given = values["alignment"]
    yield f"alignment {given['name']}: {METHODS[values['method']]}"
    yield transformation_text(given)
    yield from (feature_text(feature) for feature in values["features"])
    yield from (point_text(point) for point in values["points"])
    yield sigma0_text(values)
    revealed = revealed_text(values)
    if revealed:
        yield revealed
    yield index_text(values)
    predicted = predicted_text(values)
    if predicted:
        yield predicted
    yield from (f"flag {flag['code']}: {flag['text']}" for flag in values["flags"])
    yield from (f"note: {remark}" for remark in values["remarks"])


def transformation_text(given: Mapping[str, Any]) -> str:
    """Say shift, scale and angle of rotation."""
    rotation = np.array(given["rotation"])
    cosine = np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0)
    x, y, z = given["translation_mm"]
    text = (
        f"turned by {np.degrees(np.arccos(cosine)):.4f} degrees, the arm's origin at "
        f"{x:.4f} {y:.4f} {z:.4f} mm"
    )
    if given["scale"] != 1.0:
        text += f", scale 1 {1e6 * (given['scale'] - 1.0):+.2f} ppm"
    return text


def point_text(point: Mapping[str, Any]) -> str:
    """Say the residuals of a point, and what could have been seen of its errors."""
    # Adding zero takes the sign from what is rounded to nothing.
    x, y, z = (round(part, 4) + 0.0 for part in point["residual_mm"])
    return (
        f"{point['name']}: residual {x:+.4f} {y:+.4f} {z:+.4f} mm; "
        f"{detectable_text(point)}"
    )


def feature_text(feature: Mapping[str, Any]) -> str:
    """Say how a feature of 3-2-1 fits."""
    return (
        f"{feature['kind']} {feature['feature']}: {feature['touches']} touches, rms "
        f"{feature['rms_mm']:.4f} mm {feature['counts']}, redundancy "
        f"{feature['redundancy']}"
    )


def detectable_text(point: Mapping[str, Any]) -> str:
    """Say which errors of a point are found."""
    best, worst = point["detectable_mm"]["best"], point["detectable_mm"]["worst"]
    if best is None:
        return (
            "no error of it can be revealed; 1 mm moves the volume by "
            f"{point['hidden_in_volume_per_mm']:.2f} mm"
        )
    if worst is None:
        way = ", ".join(
            f"{round(part, 2) + 0.0:.2f}" for part in point["worst_direction"]
        )
        return (
            f"errors are found from {best:.3f} mm on at best, along ({way}) never; "
            f"1 mm there moves the volume by {point['hidden_in_volume_per_mm']:.2f} mm"
        )
    sizes = f"{best:.3f} mm on at best, {worst:.3f} mm at worst"
    return (
        f"errors are found from {f'{best:.3f} mm on' if best == worst else sizes}; "
        f"a hidden one moves the volume by {point['hidden_in_volume_mm']:.3f} mm at "
        "most"
    )


def sigma0_text(values: Mapping[str, Any]) -> str:
    """Say sigma0, with its redundancy and its interval."""
    if values["sigma0"] is None:
        return "sigma0: none, as nothing is redundant; no error can be revealed"
    unit = " mm" if values["sigma0_unit"] == "mm" else ""
    low, high = values["sigma0_interval"]
    digits = 4 if unit else 2
    text = (
        f"sigma0 {values['sigma0']:.{digits}f}{unit} with redundancy "
        f"{values['redundancy']} (true value between {low:.{digits}f} and "
        f"{high:.{digits}f}{unit} with 95 %)"
    )
    test = values["global_test"]
    if test["p_value"] is None:
        return f"{text}; no errors were stated, so it is an estimate and no test"
    verdict = "passed" if test["passed"] else "FAILED"
    return f"{text}; global test {verdict}, p = {test['p_value']:.3g}"


def revealed_text(values: Mapping[str, Any]) -> str | None:
    """Say what the global test could have revealed."""
    test = values["global_test"]
    if test is None or test["found_factor"] is None:
        return None
    return (
        f"with this redundancy errors have to be {test['found_factor']:.1f} times as "
        f"large as stated, all over, to fail the test with {test['power']:.0%}"
    )


def index_text(values: Mapping[str, Any]) -> str:
    """Say the index of the disposition."""
    quality = values["quality"]
    index = quality["index"]
    return (
        f"disposition: places in the {volume_text(quality['volume'])} are "
        f"{index['rms']:.2f} times as uncertain as a common point, {index['max']:.2f} "
        "times at the worst place"
    )


def predicted_text(values: Mapping[str, Any]) -> str | None:
    """Say the predicted error of position."""
    error = values["quality"]["predicted_error_mm"]
    if error is None:
        return None
    x, y, z = error["max_at_mm"]
    return (
        f"predicted error of position there: {error['rms']:.4f} mm rms, "
        f"{error['max']:.4f} mm at {x:.0f} {y:.0f} {z:.0f}"
    )


def volume_text(volume: Mapping[str, Any]) -> str:
    """Say a volume."""
    if volume["kind"] == "ball":
        x, y, z = volume["centre_mm"]
        where = f"ball of {volume['radius_mm']:.0f} mm about {x:.0f} {y:.0f} {z:.0f}"
    else:
        low, high = (
            " ".join(f"{part:.0f}" for part in volume[key])
            for key in ("min_mm", "max_mm")
        )
        where = f"box from {low} to {high}"
    return f"{where} ({volume['source']})"


def verdict_text(values: Mapping[str, Any]) -> str:
    """Say in a sentence what it comes to."""
    if not values["passed"]:
        return "The residuals are larger than the stated errors allow: do not use it."
    weak = [flag["code"] for flag in values["flags"]]
    if weak:
        return f"Usable with reservations: {', '.join(weak)}."
    return "Nothing speaks against it."
