"""The alignment as a page: everything in one file."""

from collections.abc import Iterator, Mapping
from typing import Any

from traverse.lab.alignment.pictures import alignment_paintings
from traverse.lab.alignment.words import (
    METHODS,
    feature_text,
    index_text,
    predicted_text,
    revealed_text,
    sigma0_text,
    transformation_text,
    verdict_text,
)
from traverse.lab.report.figures import picture
from traverse.lab.report.html import (
    image,
    note,
    paragraph,
    section,
    table,
)
from traverse.lab.report.page_frame import framed

_WIDTH_MM = 175.0


def alignment_page(values: Mapping[str, Any]) -> str:
    """Make the page; the text is complete in itself.

    Args:
        values: As in alignment.json.
    """
    given = values["alignment"]
    good = values["passed"] and not values["flags"]
    kind = "verdict" if good else "verdict bad"
    parts = [
        note(
            f"{METHODS[values['method']]}; {values['measured']} onto "
            f"{values['nominal']}; computed {values['date_utc']}"
        ),
        f'<div class="{kind}">{paragraph(verdict_text(values))}</div>',
        _transformation(values),
        _quality(values),
        _points(values),
        *_pictures(values),
    ]
    return framed(f"Alignment {given['name']}", parts)


def _transformation(values: Mapping[str, Any]) -> str:
    given = values["alignment"]
    rows = [
        [axis, *(f"{part:.9f}" for part in row), f"{shift:.5f}"]
        for axis, row, shift in zip(
            "xyz", given["rotation"], given["translation_mm"], strict=True
        )
    ]
    parts = [
        paragraph(
            f"{transformation_text(given)[0].upper()}{transformation_text(given)[1:]}."
        ),
        table(["", "rotation", "", "", "translation [mm]"], rows),
        note("part = scale * rotation * arm + translation"),
    ]
    if values["covariance"] is not None:
        told = values["covariance"]
        x, y, z = told["centre_mm"]
        stds = [
            [name, f"{std:.3g}"]
            for name, std in zip(told["parameters"], told["std"], strict=True)
        ]
        parts.append(table(["parameter", "standard deviation"], stds))
        parts.append(note(f"About the place {x:.1f} {y:.1f} {z:.1f} mm."))
    return section("transformation", "Transformation", *parts)


def _quality(values: Mapping[str, Any]) -> str:
    texts = [
        sigma0_text(values),
        revealed_text(values),
        index_text(values),
        predicted_text(values),
    ]
    return section(
        "quality",
        "What it is worth",
        *(paragraph(f"{text[0].upper()}{text[1:]}.") for text in texts if text),
        *(paragraph(f"{flag['code']}: {flag['text']}.") for flag in values["flags"]),
        *(note(f"{remark}.") for remark in values["remarks"]),
        note(
            "The disposition index is the root mean square error of position over the "
            "volume, if all common points had the same errors, over the error of a "
            "point. Residuals do not show it."
        ),
    )


def _points(values: Mapping[str, Any]) -> str:
    head = [
        "point",
        "never found along",
        "residual x [mm]",
        "y",
        "z",
        "redundancy x",
        "y",
        "z",
        "found from, best [mm]",
        "worst [mm]",
        "hidden error in the volume [mm]",
    ]
    rows = [_row(point) for point in values["points"]]
    test = values["point_test"]
    return section(
        "points",
        "Points",
        *(paragraph(f"{feature_text(one)}.") for one in values["features"]),
        table(head, rows, texts=2),
        note(
            f"An error of a point is found with {test['power']:.0%} probability by a "
            f"test with {test['level']:.1%} false alarms (Baarda) from the size on "
            "that stands there. What is not found stays in the alignment: the last "
            "column is the root mean square that it makes in the volume, at the worst."
        ),
    )


def _row(point: Mapping[str, Any]) -> list[str]:
    best, worst = point["detectable_mm"]["best"], point["detectable_mm"]["worst"]
    way = "" if worst is not None else _direction(point["worst_direction"])
    hidden = point["hidden_in_volume_mm"]
    unlimited = f"{point['hidden_in_volume_per_mm']:.2f} per mm"
    return [
        point["name"],
        "any direction" if best is None else way,
        *(f"{part:+.4f}" for part in point["residual_mm"]),
        *(f"{part:.2f}" for part in point["redundancy"]),
        "never" if best is None else f"{best:.3f}",
        "never" if worst is None else f"{worst:.3f}",
        unlimited if hidden is None else f"{hidden:.3f}",
    ]


def _direction(direction: list[float]) -> str:
    return " ".join(f"{round(part, 2) + 0.0:.2f}" for part in direction)


def _pictures(values: Mapping[str, Any]) -> Iterator[str]:
    for title, height_mm, paint in alignment_paintings(values):
        name = title.lower().replace(" ", "-")
        png = picture(_WIDTH_MM, height_mm, paint)
        yield section(name, title, image(png, title))
