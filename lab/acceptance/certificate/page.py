"""The certificate as a page, in one file with the raw data; and as lines of text."""

from collections.abc import Mapping
from typing import Any

from traverse.lab.acceptance.certificate.pictures import paintings
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.report.figures import painted
from traverse.lab.report.quantities import number
from traverse.lab.report.templates import Words, page

WIDTH_MM = 165.0
WORDS = Words("acceptance/certificate/words.jinja")
NOT_STATED = "not stated"
_MOST_PLACES = 3


def figure_cells(figure: Mapping[str, Any]) -> list[str]:
    """Write the row of a figure."""
    uncertainty_mm = figure["expanded_uncertainty_mm"]
    return [
        figure["name"],
        WORDS.decision(figure["verdict"]),
        WORDS.value(figure),
        NOT_STATED if uncertainty_mm is None else number(uncertainty_mm, ".4f"),
        number(figure["limit_mm"], ".4f"),
        number(figure["guard_mm"], ".4f"),
    ]


def administration_rows(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return who measured, where, when and what: pairs of label and text."""
    administration, source = values["administration"], values["provenance"]
    measured = [administration["measured_from_utc"], administration["measured_to_utc"]]
    warm_c = [
        administration[f"temperature_{which}_c"]
        for which in ("least", "largest", "mean")
    ]
    versions = ", ".join(f"{name} {text}" for name, text in source["versions"].items())
    return [
        ("Arm", administration["arm_name"]),
        ("Serial number of the arm", administration["arm_serial_number"] or NOT_STATED),
        ("Arm calibrated", _time(administration["arm_calibration_date"])),
        ("Measured", " to ".join(_time(entry) for entry in dict.fromkeys(measured))),
        ("Place", administration["place"] or NOT_STATED),
        ("Operator", administration["operator"] or NOT_STATED),
        (
            "Temperature",
            NOT_STATED
            if warm_c[0] is None
            else "{:.2f} to {:.2f} °C, mean {:.2f} °C".format(*warm_c),
        ),
        *(
            (
                f"Vector of {entry['name']}",
                "{:.4f}, {:.4f}, {:.4f} mm, as given".format(*entry["vector_mm"]),
            )
            for entry in administration.get("tools", ())
        ),
        ("Computed", f"{_time(source['date_utc'])}, by {source['computed_by']}"),
        ("Versions", versions),
        ("Campaign", source["campaign"]["name"]),
        ("SHA-256 of the campaign", source["campaign"]["sha256"]),
        ("SHA-256 of the arm", values["arm"]["digest"]),
    ]


def standard_cells(values: Mapping[str, Any]) -> list[list[str]]:
    """Write a row for every standard."""
    return [
        [
            standard["kind"].replace("_", " "),
            *(
                standard[key] or NOT_STATED
                for key in ("serial_number", "calibration_date", "certificate_number")
            ),
            _places(standard["artefacts"]),
        ]
        for standard in values["administration"]["standards"]
    ]


def _places(names: list[str]) -> str:
    more = len(names) - _MOST_PLACES
    return ", ".join(names[:_MOST_PLACES]) + (f" and {more} more" if more > 0 else "")


def _time(text: str | None) -> str:
    return (text or NOT_STATED).replace("T", " ").replace("Z", " UTC")


def certificate_page(certificate: SealedCertificate) -> str:
    """Make the page; the text is complete in itself."""
    values = certificate.values
    return page(
        "acceptance/certificate/page.jinja",
        {},
        values=values,
        words=WORDS,
        administration=administration_rows(values),
        standards=standard_cells(values),
        figures=[figure_cells(figure) for figure in values["figures"]],
        missing=[
            (lacking["name"], what)
            for lacking in values["missing"]
            for what in lacking["what"]
        ],
        files=certificate.files,
        pictures=painted(paintings(values), WIDTH_MM),
    )
