"""The certificate as a page, in one file with the raw data; and as lines of text."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from traverse.lab.acceptance.certificate.pictures import paintings
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.report.figures import painted
from traverse.lab.report.quantities import millimetres, number, often
from traverse.lab.report.templates import Words, page

WIDTH_MM = 165.0
WORDS = Words("acceptance/certificate/words.jinja")
NOT_STATED = "not stated"
_PLACES = {
    "laboratory": "the laboratory",
    "customer": "the customer",
    "laboratoryBranch": "a branch of the laboratory",
    "customerBranch": "a branch of the customer",
    "other": "another place",
}
_MOST_PLACES = 2


_BALL = ("ball {probe_diameter_mm:.4f} mm", "{probe_length_mm:.2f} mm from its joint")
_RANGE = ("measuring range {measuring_range_mm:.0f} mm", "reach {reach_mm:.0f} mm")
_WARM = (
    "{temperature_least_c:.2f} to {temperature_largest_c:.2f} °C, "
    "mean {temperature_mean_c:.2f} °C"
)
_WARM_STD = "u = {temperature_std_c:g} °C"
_AROUND = (
    "humidity {humidity_percent:g} %",
    "pressure {pressure_hpa:g} hPa",
    "warmed up {warm_up_min:g} min",
)


def figure_cells(figure: Mapping[str, Any]) -> list[str]:
    uncertainty_mm = figure["expanded_uncertainty_mm"]
    return [
        figure["name"],
        figure["decision"],
        WORDS.value(figure),
        NOT_STATED
        if uncertainty_mm is None
        else millimetres(uncertainty_mm, uncertainty_mm),
        "" if uncertainty_mm is None else number(figure["coverage_factor"], ".2f"),
        number(figure["limit_mm"], ".4f"),
        millimetres(figure["guard_mm"], uncertainty_mm),
    ]


BUDGET_COLUMNS = ("line", "from", "type", "degrees", "of", "u [mm]")


def budget_cells(figure: Mapping[str, Any]) -> list[list[str]]:
    return [
        [
            line["name"],
            line["formula"],
            line["evaluation"],
            "∞" if line["degrees"] is None else f"{line['degrees']:.0f}",
            "arm, tested" if line["of_arm"] else "test",
            NOT_STATED if line["standard_mm"] is None else f"{line['standard_mm']:.5f}",
        ]
        for line in figure["budget"]
    ]


def correlation_table(values: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Write head and rows of the correlation between errors of length."""
    correlation = values["length_correlation"]
    names = [str(number) for number in range(1, len(correlation["of"]) + 1)]
    rows = [
        [f"{name}: {of}", *(f"{coefficient:.2f}" for coefficient in coefficients)]
        for name, of, coefficients in zip(
            names, correlation["of"], correlation["coefficients"], strict=True
        )
    ]
    return ["", *names], rows


COMPARISON_COLUMNS = (
    "figure",
    "as found [mm]",
    "as left [mm]",
    "previous [mm]",
    "change [mm]",
    "U of the change [mm]",
)


def comparison_cells(values: Mapping[str, Any]) -> list[list[str]]:
    """Write each figure beside those before; nothing where there are none."""
    as_found, previous = (
        {
            (figure["key"], figure["tool"]): figure
            for figure in (values[what] or {"figures": ()})["figures"]
        }
        for what in ("as_found", "previous")
    )
    rows = []
    for figure in values["figures"] if as_found or previous else ():
        key = figure["key"], figure.get("tool")
        earlier, last = as_found.get(key), previous.get(key)
        rows.append(
            [
                figure["name"],
                "" if earlier is None else WORDS.value({**figure, **earlier}),
                WORDS.value(figure),
                "" if last is None else WORDS.value({**figure, **last}),
                "" if last is None else number(last["change_mm"], "+.4f"),
                "" if last is None else number(last["expanded_change_mm"], ".4f"),
            ]
        )
    return rows


def _repeats(values: Mapping[str, Any]) -> str:
    """Say how many lengths were measured how often."""
    repeats = Counter(length["artefact"] for length in values["lengths"])
    times = sorted(set(repeats.values()))
    if not times:
        return ""
    return f"; {len(repeats)} lengths, {' or '.join(map(often, times))} each"


def administration_rows(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return who measured, where, when and what: pairs of label and text."""
    administration, source = values["administration"], values["provenance"]
    measured = [administration["measured_from_utc"], administration["measured_to_utc"]]
    times = " to ".join(_time(entry) for entry in dict.fromkeys(measured))
    versions = ", ".join(f"{name} {text}" for name, text in source["versions"].items())
    return [
        *_laboratory_rows(values),
        ("Arm", _described_arm(values)),
        ("Serial number of the arm", administration["arm_serial_number"] or NOT_STATED),
        *_known("Arm adjusted", _adjusted(values)),
        ("Probe", _joined(administration, "{probe:s}", *_tip(administration))),
        ("Range", _joined(administration, *_RANGE)),
        ("Measured", f"{times}{_repeats(values)}"),
        ("Place", administration["place"] or NOT_STATED),
        ("Operator", administration["operator"] or NOT_STATED),
        ("Temperature", _joined(administration, _WARM, _WARM_STD)),
        ("Air, warming up", _joined(administration, *_AROUND)),
        *_known("Agreement", administration.get("agreement")),
        *_known("Next test", administration["next_date"]),
        *(
            (
                f"Vector of {entry['name']}",
                "{:.4f}, {:.4f}, {:.4f} mm, as given".format(*entry["vector_mm"]),
            )
            for entry in administration.get("tools", ())
        ),
        (
            "Computed",
            f"{_time(source['date_utc'])}, by {source['computed_by']}, with {versions}",
        ),
        ("Campaign", source["campaign"]["name"]),
        ("SHA-256 of the campaign", source["campaign"]["sha256"]),
        ("SHA-256 of the arm", values["arm"]["digest"]),
    ]


def _tip(administration: Mapping[str, Any]) -> tuple[str, ...]:
    if administration["probe_diameter_mm"] == 0.0:
        return ("a sensor, points on the surface",)
    return _BALL


def _laboratory_rows(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Say who certifies, for whom, and under which number."""
    stated = values.get("laboratory")
    if stated is None:
        return
    replaced = stated.get("replaces")
    replaces = f", in place of {replaced}" if replaced else ""
    label = "Number" if values["verdict"] == "withheld" else "Certificate"
    yield label, f"{stated['number']}{replaces}"
    yield "Issued", stated.get("issued") or values["date_utc"][:10]
    yield "Laboratory", _address(stated["laboratory"])
    yield "Customer", _address(stated["customer"])
    yield "Measured at", _PLACES[stated["performed_at"]]
    yield (
        "Answers for it",
        "; ".join(
            ", ".join(filter(None, (person["name"], person.get("role"))))
            for person in stated["persons"]
        ),
    )


def _address(contact: Mapping[str, str]) -> str:
    """Write a name with its address, and the accreditation of a laboratory."""
    town = f"{contact.get('post_code', '')} {contact['city']}".strip()
    code = contact.get("code")
    parts = (
        contact["name"],
        contact.get("street"),
        town,
        contact["country"],
        code and f"accreditation {code}",
    )
    return ", ".join(filter(None, parts))


def _described_arm(values: Mapping[str, Any]) -> str:
    """Write the arm's name, with maker and model where they are stated."""
    item = values.get("laboratory", {}).get("arm", {})
    made = " ".join(item[key] for key in ("manufacturer", "model") if key in item)
    name: str = values["administration"]["arm_name"]
    return f"{name}, {made}" if made else name


def _known(label: str, text: str | None) -> Iterator[tuple[str, str]]:
    """Write a row only where its text is stated."""
    if text is not None:
        yield label, text


def _joined(values: Mapping[str, Any], *parts: str) -> str:
    """Fill parts of a text with values; leave out those with an absent one."""
    filled = []
    for part in parts:
        with suppress(TypeError):  # None has no format
            filled.append(part.format_map(values))
    return ", ".join(filled) or NOT_STATED


def standard_cells(values: Mapping[str, Any]) -> list[list[str]]:
    return [
        [
            standard["kind"].replace("_", " "),
            *(
                standard[key] or NOT_STATED
                for key in (
                    "serial_number",
                    "certificate_number",
                    "calibrated_by",
                    "calibration_date",
                    "valid_until",
                )
            ),
            _expansion(standard),
            _places(standard["artefacts"]),
        ]
        for standard in values["administration"]["standards"]
    ]


STANDARD_COLUMNS = (
    "standard",
    "serial number",
    "certificate",
    "traceable to",
    "calibrated",
    "valid until",
    "expansion [ppm/°C]",
    "touched as",
)


def _expansion(standard: Mapping[str, Any]) -> str:
    """Write the coefficient with its standard uncertainty, and the material."""
    if standard["kind"] == "plane":
        return "no length"
    per_c, std_per_c = standard["expansion_per_c"], standard["expansion_std_per_c"]
    if per_c is None:
        return NOT_STATED
    material = f", {standard['material']}" if standard["material"] else ""
    std = f"u {NOT_STATED}" if std_per_c is None else f"u = {1e6 * std_per_c:.2f}"
    return f"{1e6 * per_c:.2f}, {std}{material}"


def _places(names: list[str]) -> str:
    more = len(names) - _MOST_PLACES
    return ", ".join(names[:_MOST_PLACES]) + (f" and {more} more" if more > 0 else "")


def _time(text: str | None) -> str:
    return (text or NOT_STATED).replace("T", " ").replace("Z", " UTC")


def _adjusted(values: Mapping[str, Any]) -> str | None:
    """Say when the arm was adjusted, and that it is not stated how it was found."""
    day: str | None = values["administration"]["arm_calibration_date"]
    if day is None or values["as_found"]:
        return day
    return f"{day}; as found before: {NOT_STATED}"


def missing_rows(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [
        (figure["name"], lack)
        for figure in values["missing"]
        for lack in figure["what"]
    ]


def certificate_page(certificate: SealedCertificate) -> str:
    """Make the page; the text is complete in itself."""
    values = certificate.values
    return page(
        "acceptance/certificate/page.jinja",
        {},
        values=values,
        words=WORDS,
        administration=administration_rows(values),
        columns=STANDARD_COLUMNS,
        standards=standard_cells(values),
        figures=[figure_cells(figure) for figure in values["figures"]],
        budget_columns=BUDGET_COLUMNS,
        budgets=[budget_cells(figure) for figure in values["figures"]],
        correlations=correlation_table(values),
        comparison_columns=COMPARISON_COLUMNS,
        comparison=comparison_cells(values),
        missing=missing_rows(values),
        files=certificate.files,
        pictures=painted(paintings(values), WIDTH_MM),
    )
