"""The file of limits: permissible errors, decision rule, and data of the standards."""

from collections.abc import Mapping
from datetime import date
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator

from traverse.strict_toml.reader import StrictModel

# ISO 14253-1:2017: 95 % for one limit needs 1.65 standard uncertainties.
GUARD_FACTOR = 1.65
# Of two standard uncertainties of a normal distribution (EA-4/02).
COVERAGE_PROBABILITY = 0.9545


class LengthLimit(StrictModel):
    """A limit that grows with the length: constant + per_m L, most at the most."""

    constant_mm: float = Field(ge=0.0)
    per_m_mm: float = Field(default=0.0, ge=0.0)
    most_mm: float | None = Field(default=None, gt=0.0)

    def at(self, length_mm: float) -> float:
        limit_mm = self.constant_mm + 1e-3 * length_mm * self.per_m_mm
        return limit_mm if self.most_mm is None else min(limit_mm, self.most_mm)


def _length_limit(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = {"constant_mm": value}
    if isinstance(value, Mapping):
        return LengthLimit.model_validate(dict(value))
    if isinstance(value, LengthLimit):
        return value
    raise ValueError(
        f"{value!r} is neither a number nor a table of constant_mm, per_m_mm, most_mm"
    )


Length = Annotated[Any, PlainValidator(_length_limit)]
Limit = Annotated[float | None, Field(gt=0.0)]


class Mpe(StrictModel):
    """Maximum permissible errors; a figure without one gets no decision."""

    p_size_mm: Limit = None
    p_form_mm: Limit = None
    l_dia_mm: Limit = None
    e_uni_mm: Length = None
    e_bi_mm: Length = None
    effective_diameter_mm: Limit = None
    spat_max_mm: Limit = None
    spat_2s_mm: Limit = None
    volumetric_max_mm: Limit = None
    volumetric_2rms_mm: Limit = None
    interim_length_mm: Length = None
    scan_form_25_mm: Limit = None
    scan_form_95_mm: Limit = None
    scan_size_25_mm: Limit = None
    scan_size_all_mm: Limit = None
    scan_l_dia_mm: Limit = None
    scan_flat_95_mm: Limit = None
    scan_e_uni_mm: Length = None
    scan_e_bi_mm: Length = None

    def of(self, key: str) -> LengthLimit | None:
        value = getattr(self, f"{key}_mm")
        if value is None or isinstance(value, LengthLimit):
            return value
        return LengthLimit(constant_mm=value)


class Standards(StrictModel):
    """Data of the material standards beyond the campaign's certificates.

    Attributes:
        temperature_std_c: Standard uncertainty of a standard's temperature.
        temperature_degrees: Of freedom of that, where it is of readings (type A).
        form_mm: Form error of the test sphere by its certificate.
        form_std_mm: Standard uncertainty of that.
        fixture_std_mm: How far a standard moves in its fixture while it is measured.
        fixture_degrees: Of freedom of that, where it is of readings (type A).
    """

    temperature_std_c: float = Field(default=0.0, ge=0.0)
    temperature_degrees: int | None = Field(default=None, ge=1)
    form_mm: float = Field(default=0.0, ge=0.0)
    form_std_mm: float = Field(default=0.0, ge=0.0)
    fixture_std_mm: float = Field(default=0.0, ge=0.0)
    fixture_degrees: int | None = Field(default=None, ge=1)


class Limits(StrictModel):
    """A file of limits as written.

    Attributes:
        decision: `iso14253-1` with guard bands, or `simple` acceptance without.
        guard_factor: Guard band in standard uncertainties.
        coverage_probability: Of the expanded uncertainties that are reported.
        measuring_range_mm: Diameter of the volume; else twice the reach of the arm.
        next_date: Of the next test, where it was agreed on.
        agreement: Where both parties agreed to apply a standard that is not written
            for arms.
        l_dia_radius: Whether the spheres of L_DIA are fitted with their radius free.
    """

    schema_: Literal["traverse/acceptance-limits/1"] = Field(alias="schema")
    decision: Literal["iso14253-1", "simple"] = "iso14253-1"
    guard_factor: float = Field(default=GUARD_FACTOR, ge=1.64)
    coverage_probability: float = Field(default=COVERAGE_PROBABILITY, ge=0.9, le=0.9999)
    measuring_range_mm: float | None = Field(default=None, gt=0.0)
    next_date: date | None = None
    agreement: str | None = None
    l_dia_radius: Literal["free", "calibrated"] = "free"
    mpe: Mpe = Mpe()
    standards: Standards = Standards()


NO_LIMITS = Limits(schema="traverse/acceptance-limits/1")
