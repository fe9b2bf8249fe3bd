"""Plan of touches for a standard: artefacts with nominal certificates, step by step.

Written as campaign and plan for `traverse collect`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.acceptance.procedures.b89 import N_BARS, ZONES
from traverse.lab.acceptance.procedures.length_tests import (
    LENGTH_TESTS,
    LENGTHS,
    POSITIONS,
)
from traverse.lab.acceptance.procedures.lengths import SET
from traverse.lab.acceptance.procedures.scanning import FLAT
from traverse.lab.acceptance.procedures.scanning import LOCATION as SCANNED_LOCATION
from traverse.lab.acceptance.procedures.scanning import SPHERE as SCANNED_SPHERE
from traverse.lab.acceptance.standards import DIAMETER, LOCATION, PROBING
from traverse.lab.artefacts.materials import MATERIALS
from traverse.lab.campaign.campaign_file import EXAMPLE, read_campaign_file
from traverse.lab.collection.plan import PLAN, PlanFile
from traverse.lab.measured_points.measurement import SCANNED, reach_of
from traverse.plurals import counted
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict
from traverse.strict_toml.writing import write_atomically

SPHERE = {"kind": "sphere", "radius_mm": 12.7, "radius_std_mm": 0.0003}
PER_BALL = 5
PER_FACE = 4
SCANNED_FLAT = {"kind": "plane", "form_mm": 0.0005, "form_std_mm": 0.0001}
# Somewhat more than the least that a figure needs.
PER_SCAN, PER_SCANNED_GROUP = 250, 50
LONGEST_SHARE = 0.70  # of the measuring range; at least 66 % is required
_DIRECTIONS = ("down", "left", "right", "towards", "away")
_PATTERN_25 = "1 on the pole, 4 at 22.5, 8 at 45, 4 at 67.5, 8 at 90 degrees from it"
_PATTERN_9 = "1 on the pole, 4 at 45 degrees from it, 4 on the equator"
_WAYS = (
    "along x",
    "along y",
    "upright",
    "on the space diagonal + + +",
    "on the space diagonal + + -",
    "on the space diagonal + - +",
    "on the space diagonal + - -",
)
# Of the middles of bars, as seen from the shoulder: Traverse's own choice of twenty
# positions that are spread over octants, ways and distances.
_OCTANTS = ("+ + +", "+ + -", "+ - +", "+ - -", "- + +", "- + -", "- - +", "- - -")
_SHORT_AT, _LONG_AT = (0.3, 0.6), 0.2  # parts of the reach, so that all fits in


@dataclass(frozen=True, slots=True)
class Step:
    """One step of the plan."""

    artefact: str
    feature: str
    touches: int
    say: str


@dataclass(frozen=True, slots=True)
class Plan:
    """A campaign to be collected about the shoulder: artefacts by id, and steps."""

    artefacts: Mapping[str, Mapping[str, Any]]
    steps: tuple[Step, ...]
    shoulder_mm: tuple[float, ...]
    reach_mm: float


def plan_of(standard: str, arm: Arm, *, bidirectional: bool = False) -> Plan:
    """Return what to touch.

    The reach of the arm says how long the lengths are. E_BI is optional.
    """
    shoulder_mm, reach_mm = reach_of(arm)
    artefacts: dict[str, Mapping[str, Any]] = {}
    steps: list[Step] = []
    for name, table, steps_of in _tests(standard, reach_mm, bidirectional):
        artefacts[name] = table
        steps += steps_of
    return Plan(artefacts, tuple(steps), tuple(shoulder_mm.tolist()), reach_mm)


_Test = tuple[str, Mapping[str, Any], list[Step]]


def _tests(standard: str, reach_mm: float, bidirectional: bool) -> Iterator[_Test]:
    if standard == "iso10360-12":
        yield from _spheres(reach_mm)
        yield from _lengths(reach_mm, "e_uni")
        if bidirectional:
            yield from _lengths(reach_mm, "e_bi")
    elif standard == "asme-b89.4.22":
        yield from _b89(reach_mm)
    elif standard == "iso10360-8":
        yield from _scans(reach_mm)
        if bidirectional:
            yield from _lengths(reach_mm, "scan_e_bi")
    else:
        yield from _checks(reach_mm)


def _spheres(reach_mm: float) -> Iterator[_Test]:
    where = (f"{0.3 * reach_mm:.0f} mm", f"{0.7 * reach_mm:.0f} mm")
    for name, far in zip(PROBING, where, strict=True):
        say = f"sphere about {far} from the shoulder, 25 points: {_PATTERN_25}"
        yield name, SPHERE, [Step(name, "", 25, say)]
    yield LOCATION, SPHERE, _articulated(LOCATION, 5, "")


def _articulated(name: str, touches: int, scan: str) -> list[Step]:
    say = (
        f"sphere at half reach, {scan}{touches} points with the probe pointing {{}}: "
        "turn the wrist, and leave the sphere where it is"
    )
    return [Step(name, way, touches, say.format(way)) for way in _DIRECTIONS]


def _lengths(reach_mm: float, key: str) -> Iterator[_Test]:
    prefix = LENGTH_TESTS[key][1]
    per_face = PER_SCANNED_GROUP if prefix.startswith(SCANNED) else PER_FACE
    longest_mm = LONGEST_SHARE * 2.0 * reach_mm
    lengths_mm = [
        float(np.ceil(longest_mm * number / LENGTHS / 10.0) * 10.0)
        for number in range(1, LENGTHS + 1)
    ]
    for position in range(1, POSITIONS + 1):
        for number, length_mm in enumerate(lengths_mm, 1):
            name = f"{prefix}-{position}-{number}"
            way = _WAYS[position - 1]
            if key == "e_uni":
                ends = {"a": [0.0, 0.0, 0.0], "b": [length_mm, 0.0, 0.0]}
                table = {
                    "kind": "points",
                    "frame": "own",
                    "points_std_mm": 0.0004,
                    "points_mm": ends,
                }
                say = f"length of {length_mm:.0f} mm {way}: ball into seat"
                features, touches = ("a", "b"), 1
            else:
                table = {
                    "kind": "parallel_planes",
                    "distance_mm": length_mm,
                    "distance_std_mm": 0.0005,
                }
                say = f"block of {length_mm:.0f} mm {way}: {per_face} points on face"
                features, touches = ("1", "2"), per_face
            yield name, table, _repeated(name, features, touches, say, SET)


def _b89(reach_mm: float) -> Iterator[_Test]:
    say = f"sphere at half reach, 9 points: {_PATTERN_9}; repeat"
    yield (
        DIAMETER,
        SPHERE,
        [Step(DIAMETER, str(n), 9, f"{say} {n}") for n in range(1, 4)],
    )
    for zone, (low, high) in ZONES.items():
        name, middle_mm = f"spat-{zone}", 0.5 * (low + high) * reach_mm
        yield (
            name,
            {"kind": "cone"},
            [
                Step(
                    name,
                    side,
                    5,
                    f"cone about {middle_mm:.0f} mm from the shoulder, 5 points with "
                    f"the elbow to the {side}, another posture each time",
                )
                for side in ("left", "right")
            ],
        )
    for number in range(1, N_BARS + 1):
        is_short = number <= N_BARS // 2
        share = 0.6 if is_short else 1.3
        length_mm = float(np.ceil(share * reach_mm / 10.0) * 10.0)
        name = f"volumetric-{number:02d}"
        say = (
            f"bar of {length_mm:.0f} mm, position {number} of {N_BARS}: "
            f"{_position(number - 1, reach_mm, is_short=is_short)}, {PER_BALL} points "
            "on sphere"
        )
        yield name, _bar(length_mm), _repeated(name, ("1", "2"), PER_BALL, say, 1)


def _position(row: int, reach_mm: float, *, is_short: bool) -> str:
    """Say which way a bar lies, and where its middle is.

    The long bar goes through the octants in other ways than the short one.
    """
    position = _SHORT_AT[row % 2] if is_short else _LONG_AT
    way = _WAYS[row % len(_WAYS)]
    octant = _OCTANTS[(row if is_short else row + 3) % len(_OCTANTS)]
    return (
        f"{way}, its middle {position * reach_mm:.0f} mm from the shoulder in the "
        f"octant {octant} of x y z"
    )


def _scans(reach_mm: float) -> Iterator[_Test]:
    yield (
        SCANNED_SPHERE,
        SPHERE,
        [
            Step(
                SCANNED_SPHERE,
                "",
                PER_SCAN,
                f"sphere at half reach ({0.5 * reach_mm:.0f} mm), not the one that the "
                f"probe was found with: scan the half sphere, {PER_SCAN} points or "
                "more, the probe pointing one way",
            )
        ],
    )
    steps = _articulated(SCANNED_LOCATION, PER_SCANNED_GROUP, "scan ")
    yield SCANNED_LOCATION, SPHERE, steps
    say = f"flat at half reach, tilted by 45 degrees: scan all of it, {PER_SCAN} points"
    yield FLAT, SCANNED_FLAT, [Step(FLAT, "", PER_SCAN, say)]


def _checks(reach_mm: float) -> Iterator[_Test]:
    length_mm = float(np.ceil(0.6 * reach_mm / 10.0) * 10.0)
    for position in range(1, POSITIONS + 1):
        name, way = f"check-{position}", _WAYS[position - 1]
        say = f"bar of {length_mm:.0f} mm {way}, {PER_BALL} points on sphere"
        yield name, _bar(length_mm), _repeated(name, ("1", "2"), PER_BALL, say, SET)


def _bar(length_mm: float) -> Mapping[str, Any]:
    return {
        "kind": "ball_bar",
        "radius_mm": 12.7,
        "distance_mm": length_mm,
        "distance_std_mm": 0.0005,
    }


def _repeated(
    name: str, features: tuple[str, str], touches: int, say: str, repeats: int
) -> list[Step]:
    return [
        Step(name, feature, touches, f"{say} {feature}, time {repeat} of {repeats}")
        for repeat in range(1, repeats + 1)
        for feature in features
    ]


CAMPAIGN = "campaign.toml"
_HEAD = """\
# What `traverse verify --plan {standard}` proposes to touch.
# Put in the lengths, radii, uncertainties and expansion of YOUR certificates, and then
# the serial number of each standard in place of EXAMPLE: until then nothing counts.
# A verdict needs of each standard, beside its serial number, the lines
#   certificate_number = "..."      calibrated_by = "laboratory, accreditation"
#   calibration_date = 2026-01-31   valid_until = 2028-01-31
#   material = "{materials}"
#   or, by its certificate, expansion_per_c and expansion_std_per_c
# and below [circumstances] its values. `traverse verify` names those that are missing.
# Ids and features say which test a touch belongs to; keep them.
"""


def write_plan(plan: Plan, standard: str, folder: Path) -> dict[str, Any]:
    """Write campaign.toml and plan.toml; return their contents.

    Raises:
        FileError: A campaign is there already; it is not replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in (CAMPAIGN, PLAN):
        if (folder / name).exists():
            message = "is there already; give another folder, or move it away"
            raise FileError(folder / name, message)
    marked = replace(plan, artefacts=dict(_marked(plan.artefacts)))
    write_atomically(
        folder / CAMPAIGN,
        _HEAD.format(standard=standard, materials=" | ".join(MATERIALS))
        + campaign_text(
            marked, operator=EXAMPLE, place=EXAMPLE, circumstances={"probe": EXAMPLE}
        ),
    )
    write_atomically(folder / PLAN, plan_text(plan))
    read_campaign_file(folder / CAMPAIGN)
    read_strict(folder / PLAN, PlanFile)
    return {
        "folder": str(folder),
        "files": [CAMPAIGN, PLAN],
        "artefacts": len(plan.artefacts),
        "steps": len(plan.steps),
        "touches": sum(step.touches for step in plan.steps),
        "hours": round(_hours(plan), 1),
        "standards": [
            {"kind": kind, "size_mm": size_mm}
            for kind, size_mm in _standards(plan.artefacts)
        ],
    }


def plan_words(report: Mapping[str, Any]) -> list[str]:
    """Files written, and steps to carry out."""
    ends = (("artefact", "s"), ("step", "s"), ("touch", "es"))
    counts = [counted(report[f"{what}{end}"], what) for what, end in ends]
    folder = report["folder"]
    return [
        f"{', '.join(counts)}; about {report['hours']} h with an hour of warming up",
        f"to borrow: {', '.join(_borrowed(report['standards']))}",
        f"wrote {folder}: {', '.join(report['files'])}",
        f"put the values and serial numbers of your certificates into {CAMPAIGN}, "
        f"where EXAMPLE stands, then: traverse collect {Path(folder) / CAMPAIGN} "
        "--arm ARM",
    ]


def _borrowed(standards: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Name each kind of standard once, with its sizes."""
    sizes: dict[str, list[str]] = {}
    for standard in standards:
        sizes.setdefault(standard["kind"], []).append(f"{standard['size_mm']:g}")
    for kind, of_kind in sizes.items():
        quantity = {"sphere": "radius", "flat": "form error"}.get(kind, "length")
        yield f"{kind} of {quantity} {', '.join(of_kind)} mm"


def _marked(
    artefacts: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Mark calibrated artefacts as examples, standards of one kind and size alike."""
    standards = _standards(artefacts)
    for name, table in artefacts.items():
        standard = _standard_of(table)
        if standard is None:
            yield name, table
            continue
        word, _ = standard
        alike = [known for known in standards if known[0] == word]
        number = f"{EXAMPLE} {word} {alike.index(standard) + 1}"
        yield name, {**table, "serial_number": number}


def _standard_of(table: Mapping[str, Any]) -> tuple[str, float] | None:
    """Return what a standard is and its size; None of a cone, which has none."""
    if "points_mm" in table:
        return "bar", table["points_mm"]["b"][0]
    if "distance_mm" in table:
        word = "block" if table["kind"] == "parallel_planes" else "bar"
        return word, table["distance_mm"]
    if "form_mm" in table:
        return "flat", table["form_mm"]
    return ("sphere", table["radius_mm"]) if "radius_mm" in table else None


def _standards(
    artefacts: Mapping[str, Mapping[str, Any]],
) -> list[tuple[str, float]]:
    """List the physical standards, in the order of their use."""
    all_standards = map(_standard_of, artefacts.values())
    return list(dict.fromkeys(each for each in all_standards if each is not None))


# General knowledge: a touch by hand, a point of a scan, another place for a standard,
# and warming up.
_TOUCH_S, _SCANNED_S, _PLACE_S, _WARM_UP_S = 8.0, 0.2, 150.0, 3600.0


def _hours(plan: Plan) -> float:
    seconds = _WARM_UP_S + _PLACE_S * len(plan.artefacts)
    for step in plan.steps:
        is_scan = step.artefact.startswith(SCANNED)
        seconds += step.touches * (_SCANNED_S if is_scan else _TOUCH_S)
    return seconds / 3600.0


def campaign_text(plan: Plan, **more: object) -> str:
    artefacts = [{"id": name, **table} for name, table in plan.artefacts.items()]
    head = {"schema": "traverse/campaign/1", "poses": "poses.csv"}
    return tomlkit.dumps({**head, **more, "artefacts": artefacts})


def plan_text(plan: Plan) -> str:
    return tomlkit.dumps(
        {
            "schema": "traverse/collection-plan/1",
            "centre_mm": list(plan.shoulder_mm),
            "reach_mm": plan.reach_mm,
            "steps": [asdict(step) for step in plan.steps],
        }
    )
