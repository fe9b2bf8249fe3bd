"""What a digital calibration certificate states, as values for its template.

Uncertainties are rounded to two digits and their values to the same place (GUM 7.2.6).
"""

from collections.abc import Iterator, Mapping
from math import erf, floor, log10, sqrt
from typing import Any

COVERAGE_FACTOR = 2.0

# Units of D-SI (BIPM SI brochure) by those of reports.
UNITS = {
    "": r"\one",
    "mm": r"\milli\metre",
    "rad": r"\radian",
    "s": r"\second",
    "C": r"\degreecelsius",
    "ppm": r"\ppm",
    "rad/C": r"\radian\degreecelsius\tothe{-1}",
    "rad/s": r"\radian\second\tothe{-1}",
    "rad/(N m)": r"\radian\newton\tothe{-1}\metre\tothe{-1}",
    "1/C": r"\degreecelsius\tothe{-1}",
    "mm/N": r"\milli\metre\newton\tothe{-1}",
    "mm/s": r"\milli\metre\second\tothe{-1}",
}

# Between the guard bands conformity is not proved: no pass, which is no failure.
_CONFORMITY = {"accept": "pass", "reject": "fail", "neither": "noPass"}
_MOST_DECIMALS = 15


def quantity(
    name: str,
    value: float,
    unit: str,
    expanded: float | None = None,
    coverage_factor: float = COVERAGE_FACTOR,
    **more: object,
) -> dict[str, Any]:
    """Describe a number, with its expanded uncertainty where that is stated.

    Raises:
        KeyError: D-SI has no such unit.
    """
    found: dict[str, Any] = {"name": name, "unit": UNITS[unit]}
    found |= {"ref_type": None, "statement": None, **more}
    if not expanded:
        # Four decimals of a millimetre, as on paper; six digits of anything else.
        decimals = 4 if unit in ("mm", "C") else _decimals(value, 6)
        text = str(value) if isinstance(value, int) else f"{value:.{decimals}f}"
        return found | {"value": text, "expanded": None}
    decimals = _decimals(expanded, 2)
    return found | {
        "value": f"{value:.{decimals}f}",
        "expanded": f"{expanded:.{decimals}f}",
        "coverage_factor": f"{coverage_factor:g}",
        "probability": f"{erf(coverage_factor / sqrt(2.0)):.4f}",
    }


def _decimals(number: float, digits: int) -> int:
    if number == 0.0:
        return digits
    return min(max(digits - 1 - floor(log10(abs(number))), 0), _MOST_DECIMALS)


def _line(text: object) -> str:
    """Put a text into one line without spaces around it."""
    return " ".join(str(text).split())


def _statement(name: str, text: object = "", **more: object) -> dict[str, Any]:
    empty = {"norm": None, "conformity": None}
    return {"name": name, "text": _line(text), **empty, **more}


def _common(
    administration: Mapping[str, Any], provenance: Mapping[str, Any], digest: str
) -> dict[str, Any]:
    """Describe what verifications and identifications have alike.

    Raises:
        ValueError: The dates of the measurement are not stated.
    """
    dates = [administration[f"measured_{end}_utc"] for end in ("from", "to")]
    if None in dates:
        raise ValueError(
            "the date of the measurement is not stated, without which nothing is "
            "certified; give start_utc in campaign.toml, or time_ns with points"
        )
    serial = administration["arm_serial_number"]
    temperatures = [
        quantity(f"temperature of the arm, {name}", value_c, "C")
        for name in ("least", "mean", "largest")
        if (value_c := administration[f"temperature_{name}_c"]) is not None
    ]
    said = [
        _statement(key.capitalize(), administration[key])
        for key in ("place", "operator")
        if administration[key]
    ]
    said += [
        _statement(f"Vector of {one['name']}", f"{one['vector_mm']} mm, as given")
        for one in administration.get("tools", ())
    ]
    return {
        "begin": dates[0][:10],
        "end": dates[1][:10],
        "versions": provenance["versions"],
        "arm": {
            "name": _line(administration["arm_name"]),
            "identifications": [
                *([("manufacturer", "serial number", _line(serial))] if serial else ()),
                ("other", "SHA-256 of the values of the arm file", digest),
            ],
        },
        "equipment": [_equipment(one) for one in administration["standards"]],
        "conditions": temperatures,
        "statements": said,
    }


def _equipment(standard: Mapping[str, Any]) -> dict[str, Any]:
    named = [
        (issuer, name, _line(standard[key]))
        for issuer, name, key in (
            ("manufacturer", "serial number", "serial_number"),
            ("other", "number of the certificate", "certificate_number"),
            ("other", "date of calibration", "calibration_date"),
        )
        if standard[key]
    ]
    places = ", ".join(standard["artefacts"])
    kind = standard["kind"].replace("_", " ")
    return {"name": kind, "text": f"touched as {places}", "identifications": named}


def verification_document(values: Mapping[str, Any]) -> dict[str, Any]:
    """Describe the values of a `certificate.json`.

    Raises:
        ValueError: Something is missing without which nothing is certified.
    """
    found = _common(
        values["administration"], values["provenance"], values["arm"]["digest"]
    )
    decision = values["decision"]
    rule = (
        "simple acceptance: no guard band"
        if decision["rule"] == "simple"
        else f"ISO 14253-1 with a guard band of {decision['guard_factor']:g} standard "
        "uncertainties"
    )
    figures = values["figures"]
    verdicts = {figure["verdict"] for figure in figures}
    conformity: dict[str, object] = {}
    if verdicts & {"reject"}:
        conformity = {"conformity": "fail"}
    elif verdicts == {"accept"} and not values["missing"]:
        conformity = {"conformity": "pass"}
    statements = [
        *found.pop("statements"),
        _statement("Decision rule", rule),
        _statement(
            "Conformity", _decided(values), norm=_line(values["title"]), **conformity
        ),
        *(_statement("Remark", remark) for remark in values["remarks"]),
    ]
    if not figures:
        raise ValueError("no figure of the standard was computed; complete the touches")
    return found | {
        "title": f"Verification by {values['title']}",
        "method": {
            "name": "Verification",
            "text": "The uncertainty is that of the test: certificate, temperature, "
            "expansion, form and fixture of the standard. Errors of the arm are what "
            "is tested and are no part of it.",
            "norm": _line(values["title"]),
        },
        "statements": statements,
        "results": [_figure(figure, values["decision"]) for figure in figures],
    }


def _decided(values: Mapping[str, Any]) -> str:
    words = {
        "accept": "accepted",
        "reject": "rejected",
        "neither": "neither accepted nor rejected",
        "undecided": "no decision, for want of an uncertainty",
        None: "no limit given",
    }
    parts = [f"{one['name']}: {words[one['verdict']]}" for one in values["figures"]]
    parts += [f"{one['name']}: not computed" for one in values["missing"]]
    return "; ".join(parts)


def _figure(figure: Mapping[str, Any], decision: Mapping[str, Any]) -> dict[str, Any]:
    verdict = figure["verdict"]
    stated = None
    if verdict in _CONFORMITY:
        stated = _statement(
            "Conformity", figure["rule"], conformity=_CONFORMITY[verdict]
        )
    quantities = [
        quantity(
            "value",
            figure["value_mm"],
            "mm",
            figure["expanded_uncertainty_mm"],
            decision["coverage_factor"],
            ref_type="basic_measuredValue",
            statement=stated,
        )
    ]
    if figure["limit_mm"] is not None:
        limit_mm = figure["limit_mm"]
        quantities.append(quantity("maximum permissible error", limit_mm, "mm"))
    text = "; ".join(
        filter(None, [figure["definition"], figure["confirm"], *figure["remarks"]])
    )
    return {"name": figure["name"], "text": _line(text), "quantities": quantities}


def identification_document(
    values: Mapping[str, Any], administration: Mapping[str, Any], digest: str
) -> dict[str, Any]:
    """Describe the values of an `identification.json`.

    Raises:
        ValueError: Something is missing without which nothing is certified.
    """
    found = _common(administration, values["provenance"], digest)
    test = values["global_test"]
    tested = "not possible: the noise was estimated, or nothing is redundant"
    if test["p_value"] is not None and not test["noise_estimated"]:
        fits = "passed" if test["passed"] else "failed"
        tested = f"{fits}, probability {test['p_value']:.2g}"
    statements = [
        *found.pop("statements"),
        _statement("Conformity", "none is stated: an identification decides nothing"),
        _statement("Global test of the adjustment", tested),
        _statement(
            "Poses",
            f"{sum(one['n'] for one in values['artefacts'].values())} used, "
            f"{len(values['excluded'])} left out as contradicting the others",
        ),
        *(
            _statement(
                "Contradiction",
                f"the certificate of {one['artefact']} contradicts the rest and took "
                "no part",
            )
            for one in values["contradictions"]
        ),
        *(
            _statement("Undetermined", f"{' '.join(one['direction'])}: {one['why']}")
            for one in values["undetermined"]
        ),
    ]
    return found | {
        "title": "Identification of the geometry of an articulated arm",
        "method": {
            "name": "Least-squares adjustment",
            "text": "Changes of the parameters against the design arm file, with the "
            "uncertainties of the adjustment; their covariances are in arm.cov.npz.",
            "norm": None,
        },
        "statements": statements,
        "results": list(_identified(values)),
    }


def _identified(values: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    rms_mm = values["rms_mm"]
    yield {
        "name": "Misclosures",
        "text": "root mean square of scalar misclosures, of all poses with the design "
        "and of those used with the estimates; sigma0 is their size against the noise",
        "quantities": [
            quantity("rms before", rms_mm["before"], "mm"),
            quantity("rms after", rms_mm["after"], "mm"),
            quantity("sigma0", values["sigma0"], ""),
            quantity("redundancy", values["redundancy"], ""),
        ],
    }
    for one in values["parameters"]:
        yield {
            "name": one["name"],
            "text": "change against the design arm file",
            "quantities": [
                quantity(
                    "estimate",
                    one["value"],
                    one["unit"],
                    COVERAGE_FACTOR * one["std"],
                    ref_type="basic_measuredValue",
                )
            ],
        }
    for name, artefact in values["artefacts"].items():
        for length, entry in artefact.items():
            if not isinstance(entry, dict) or set(entry) != {"value", "std"}:
                continue
            yield {
                "name": f"{name}: {length.removesuffix('_mm').replace('_', ' ')}",
                "text": "as the arm measures it, its own certificate left out",
                "quantities": [
                    quantity(
                        "estimate",
                        entry["value"],
                        "mm",
                        COVERAGE_FACTOR * entry["std"],
                        ref_type="basic_measuredValue",
                    )
                ],
            }
