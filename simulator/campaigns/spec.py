"""Specification of a simulated campaign (docs/reference/simulated-campaigns.md).

The tables are frozen values: made in Python, or read from a TOML file.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

from pydantic import AwareDatetime, Field, field_validator

from traverse.simulator.arm.truth import Deviations
from traverse.simulator.campaigns.artefacts import (
    AnyArtefact,
    Artefact,
    BallBar,
    Cone,
    DrawWire,
    ParallelPlanes,
    Plane,
    Points,
    Seats,
    Sphere,
)
from traverse.strict_toml.problems import Problem
from traverse.strict_toml.reader import StrictModel

Maker = Callable[[str, int, float], Artefact]  # id, poses, width [mm]


def mix_artefacts(name: str, n_poses: int, width_mm: float) -> tuple[Artefact, ...]:
    """Return the artefacts of a mix, a key of `MIXES`, with evenly shared poses.

    Artefacts without poses are left out.
    """
    makers = MIXES[name]
    share, remainder = divmod(n_poses, len(makers))
    counts = [share + (number < remainder) for number in range(len(makers))]
    makers_and_counts = zip(makers.items(), counts, strict=True)
    return tuple(
        maker(id_, count, width_mm)
        for (id_, maker), count in makers_and_counts
        if count
    )


def _maker(
    kind: type[Artefact],
    shares: Mapping[str, float] | None = None,
    **values: float | str,
) -> Maker:
    """Return a maker of artefacts with lengths that are shares of the width."""

    def make(name: str, n_poses: int, width_mm: float) -> Artefact:
        # Whole millimetres, as makers of standards like them.
        lengths_mm = {
            key: max(1.0, round(share * width_mm))
            for key, share in (shares or {}).items()
        }
        keys: dict[str, Any] = {**lengths_mm, **values}
        return kind(id=name, n_poses=n_poses, **keys)

    return make


_cone = _maker(Cone)
_seats = _maker(Seats, {"distance_mm": 0.3}, distance_std_mm=0.0005)
_wire = _maker(DrawWire, {"shortest_mm": 0.1, "longest_mm": 0.6}, offset_mm=35.0)
_bar, _short_bar = (
    _maker(BallBar, {"distance_mm": share}, radius_mm=12.7, distance_std_mm=0.0005)
    for share in (0.45, 0.25)
)
_sphere = _maker(Sphere, {"radius_mm": 0.03})
_known_sphere = _maker(Sphere, {"radius_mm": 0.04}, known=True, radius_std_mm=0.0002)
_hollow_sphere = _maker(Sphere, {"radius_mm": 0.05}, side="inside")
_plane = _maker(Plane, {"size_mm": 0.3})
_gauge = _maker(
    ParallelPlanes, {"distance_mm": 0.3, "size_mm": 0.08}, distance_std_mm=0.0005
)
_gap = _maker(
    ParallelPlanes,
    {"distance_mm": 0.2, "size_mm": 0.08},
    distance_std_mm=0.0005,
    side="inside",
)
_arm_points = _maker(Points, {"size_mm": 0.25}, frame="arm")
_own_points = _maker(Points, {"size_mm": 0.25}, frame="own")
_scaled_points = _maker(Points, {"size_mm": 0.25}, frame="own_scaled", scale=1.0005)


def _several(name: str, maker: Maker, count: int) -> dict[str, Maker]:
    return {f"{name}-{number + 1}": maker for number in range(count)}


MIXES: Mapping[str, Mapping[str, Maker]] = {
    "cones": _several("cone", _cone, 5),
    "cones+bar": {**_several("cone", _cone, 5), "bar": _bar},
    "bars": {
        **_several("bar", _bar, 4),
        **_several("short-bar", _short_bar, 2),
    },
    "seats": _several("bar", _seats, 4),
    "wires": _several("wire", _wire, 3),
    "sphere-known": _several("ball", _known_sphere, 4),
    "planes+length": {**_several("plate", _plane, 5), "gauge": _gauge},
    "points-arm": {"grid": _arm_points},
    "points-own": _several("grid", _own_points, 2),
    "everything": {
        **_several("cone", _cone, 3),
        **_several("bar", _bar, 2),
        "sphere": _sphere,
        "ball": _known_sphere,
        "bowl": _hollow_sphere,
        **_several("plate", _plane, 2),
        "gauge": _gauge,
        "gap": _gap,
        "grid-arm": _arm_points,
        "grid-own": _own_points,
        "grid-scaled": _scaled_points,
    },
}


Column = Literal["temperature", "approach", "speed", "direction", "force"]
COLUMNS: tuple[Column, ...] = (
    "temperature",
    "approach",
    "speed",
    "direction",
    "force",
)
BlunderKind = Literal["contact", "encoder", "label", "orientation"]


class NoiseTable(StrictModel):
    """Errors between the truth and the file.

    Attributes:
        encoder_rad: standard deviation of every reading.
        encoders_rad: one for each joint, instead.
        contact_mm: standard deviation of a contact along the normal; in three
            directions in a seat.
        serial_share: serially correlated part of the variance of both.
        serial_phi: correlation of that part from one pose to the next.
        quantised: readings are whole counts of the arm file's encoders.
        direction_rad: error of a stated direction, in each of two directions across.
        blunder_share: share of poses with blunders.
        blunder_sigma: size of a blunder, in standard deviations of the misclosure.
        blunder_kinds: possible ones: the contact is displaced, an encoder has
            jumped, the label is that of another feature, the orientation is off.
        orientation_rad: standard deviation of a measured orientation about each axis.
        stated: the campaign states the standard deviations.
        stated_factor: stated over true noise.
    """

    encoder_rad: float = Field(default=5e-6, ge=0.0)
    encoders_rad: tuple[float, ...] | None = None
    contact_mm: float = Field(default=0.005, ge=0.0)
    serial_share: float = Field(default=0.0, ge=0.0, le=1.0)
    serial_phi: float = Field(default=0.95, ge=0.0, lt=1.0)
    quantised: bool = False
    direction_rad: float = Field(default=0.02, ge=0.0)
    blunder_share: float = Field(default=0.0, ge=0.0, le=0.5)
    blunder_sigma: float = Field(default=15.0, gt=0.0)
    blunder_kinds: tuple[BlunderKind, ...] = ("contact", "encoder")
    orientation_rad: float = Field(default=1e-4, ge=0.0)
    stated: bool = True
    stated_factor: float = Field(default=1.0, gt=0.0)

    @field_validator("blunder_kinds")
    @classmethod
    def _some_kind(cls, kinds: tuple[BlunderKind, ...]) -> tuple[BlunderKind, ...]:
        if not kinds:
            raise ValueError("is empty; name at least one kind of blunder")
        return kinds

    @field_validator("encoders_rad")
    @classmethod
    def _no_negative(cls, stds: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if stds is not None and min(stds, default=0.0) < 0.0:
            raise ValueError(f"{min(stds):g} is negative; expected 0 or more")
        return stds


class ConditionTable(StrictModel):
    """Conditions of measurement.

    Attributes:
        interval_s: mean interval between poses.
        visits: how often the operator returns to every artefact.
        swing_c: amplitude of a slow wave of the temperature.
        drift_c: even rise from the first pose to the last.
        speed_rad_s: standard deviation of the joints' speeds at a contact.
        force_spread: standard deviation of its logarithm.
        columns: optional columns that are written.
        start_utc: when time_s is 0.
    """

    interval_s: float = Field(default=4.0, gt=0.0)
    visits: int = Field(default=3, ge=1)
    temperature_c: float = 20.0
    swing_c: float = Field(default=0.0, ge=0.0)
    drift_c: float = 0.0
    speed_rad_s: float = Field(default=0.0, ge=0.0)
    force_n: float = Field(default=0.5, gt=0.0)
    force_spread: float = Field(default=0.3, ge=0.0)
    columns: tuple[Column, ...] = COLUMNS
    start_utc: AwareDatetime | None = None


class CampaignSpec(StrictModel):
    """A campaign, but for its arm and its seed.

    Attributes:
        mix: name of a mix of artefacts, with `n_poses` for all of them.
        artefacts: instead of a mix.
        deviations: of the true arm from its file.
        travel: joint limits, about the base posture.
        limits_rad: a pair [low, high] for each joint, instead.
        noise: between the truth and the file.
    """

    mix: str | None = None
    n_poses: int | None = Field(default=None, ge=1)
    artefacts: tuple[AnyArtefact, ...] = ()
    deviations: Deviations = Deviations(links_mm=0.5, axes_rad=2e-3, zeros_rad=2e-3)
    travel: Literal["full", "wide", "narrow"] = "wide"
    limits_rad: tuple[tuple[float, float], ...] | None = None
    noise: NoiseTable = NoiseTable()
    conditions: ConditionTable = ConditionTable()

    @field_validator("mix")
    @classmethod
    def _known_mix(cls, mix: str | None) -> str | None:
        if mix is not None and mix not in MIXES:
            raise ValueError(f"unknown mix '{mix}'; known: {', '.join(sorted(MIXES))}")
        return mix

    @field_validator("limits_rad")
    @classmethod
    def _rising(
        cls, limits: tuple[tuple[float, float], ...] | None
    ) -> tuple[tuple[float, float], ...] | None:
        for number, (low, high) in enumerate(limits or ()):
            if low >= high:
                raise ValueError(
                    f"entry {number} is [{low:g}, {high:g}]; the first must be smaller"
                )
        return limits


class CampaignFile(CampaignSpec):
    """A whole file, with arm and seed."""

    schema_: Literal["traverse/simulated-campaign/1"] = Field(alias="schema")
    arm: str
    seed: int = Field(default=1, ge=0)


def spec_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    if ("mix" in raw) == bool(raw.get("artefacts")):
        mistake = "both are given" if "mix" in raw else "neither is given"
        yield Problem("mix", f"a mix or artefacts: {mistake}; give one of them")
    elif ("mix" in raw) != ("n_poses" in raw):
        message = (
            "is missing; say how many poses the mix has"
            if "mix" in raw
            else "goes with a mix; artefacts say their own numbers; remove it"
        )
        yield Problem("n_poses", message)
    artefacts = raw.get("artefacts")
    tables = artefacts if isinstance(artefacts, list) else []
    ids = Counter(
        str(table["id"])
        for table in tables
        if isinstance(table, Mapping) and "id" in table
    )
    for name, count in ids.items():
        if count > 1:
            message = f"'{name}' is used {count} times; each needs its own id"
            yield Problem("artefacts", message)
