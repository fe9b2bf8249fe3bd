"""`python -m benchmarks.daily_check [YEARS]`: simulated years of daily checks.

Arms with errors of their own are checked each working day, the cone and the sphere in
other postures each time. Arms without change show the rate of false warnings; arms that
drift from day 51 on, or are knocked that day, show after how many checks it is found.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tools.command_line import run_main
from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.cone import Cone
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.daily_check.control_chart import charted, rules
from traverse.lab.daily_check.figures import (
    KINDS,
    DailyCheckFigures,
    daily_check_figures,
)
from traverse.lab.measured_points.measurement import ArtefactTouches, Measurement

ARM = Path(__file__).parent.parent / "cli" / "demo_data" / "arm.toml"
YEARS = 600
CHECKS = 250
BEGINS = 50
POOL, SPREAD_RAD = 600, 0.9
ENCODER_RAD, CONTACT_MM = 3e-6, 0.003
OWN_RAD = 6e-6  # harmonic errors of each joint that no identification took away
RADIUS_MM, TIP_MM = 12.7, 3.0
SEAT_MM = np.array([500.0, 0.0, 100.0])


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault on a day.

    Attributes:
        eccentricity_rad: of the third joint's encoder.
        tip_mm: added to the radius of the tip.
        scatter: factor on contact and encoder noise.
    """

    eccentricity_rad: float = 0.0
    tip_mm: float = 0.0
    scatter: float = 1.0


def _since(day: int) -> float:
    return max(0, day - BEGINS) / (CHECKS - BEGINS)


SCENARIOS: dict[str, Callable[[int], Fault]] = {
    "nothing changes": lambda day: Fault(),
    "encoder of J3 wanders off, 40 urad by the end of the year": lambda day: Fault(
        eccentricity_rad=40e-6 * _since(day)
    ),
    "encoder of J3 is knocked, 40 urad": lambda day: Fault(
        eccentricity_rad=40e-6 * (day >= BEGINS)
    ),
    "tip wears, 10 um of radius by the end of the year": lambda day: Fault(
        tip_mm=-0.010 * _since(day)
    ),
    "another tip, 5 um smaller": lambda day: Fault(tip_mm=-0.005 * (day >= BEGINS)),
    "touches scatter half as much again": lambda day: Fault(
        scatter=1.5 if day >= BEGINS else 1.0
    ),
}


class CheckedArm:
    """An arm with errors of its own, and postures in which it reaches the cone.

    A measured place is the place plus the errors of the readings in the posture of the
    touch.
    """

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0x1D])
        arm = read_arm(ARM)
        self._geometry = geometry_from_arm(arm)
        zero = np.array([joint.zero_rad for joint in arm.joints])
        n = len(zero)
        middle = zero + np.array([0.3, 0.6, 0.2, -0.8, 0.3, 0.7, 0.1])[:n]
        self._pool = middle + self._rng.uniform(-SPREAD_RAD, SPREAD_RAD, (POOL, n))
        self._own = self._rng.normal(0.0, OWN_RAD, (2, 2, n))
        ball = {"id": "sphere", "kind": "sphere", "radius_mm": RADIUS_MM}
        self._artefacts: dict[str, Artefact] = {
            "cone": Cone.model_validate({"id": "cone", "kind": "cone"}),
            "sphere": Sphere.model_validate(ball),
        }

    def check(self, fault: Fault) -> DailyCheckFigures:
        ways = self._ways()
        outwards = (RADIUS_MM + TIP_MM + fault.tip_mm) * ways
        places = np.vstack([np.tile(SEAT_MM, (10, 1)), SEAT_MM + outwards])
        places = places + self._errors_mm(len(places), fault)
        touched = {
            "cone": _touched(places[:10]),
            "sphere": _touched(places[10:]),
        }
        return daily_check_figures(
            Measurement(self._artefacts, touched, "simulated", np.zeros(3), 1000.0)
        )

    def _ways(self) -> Floats:
        """One pole, four at 45 degrees, four on the equator, by a hand."""
        turned = 0.5 * np.pi * np.arange(4)
        low = np.column_stack([np.cos(turned), np.sin(turned), np.zeros(4)])
        high = np.array([0.0, 0.0, 1.0])
        ways = np.vstack([high, (low + high) / np.sqrt(2.0), low])
        ways = ways + self._rng.normal(0.0, 0.05, ways.shape)
        directions: Floats = ways / np.linalg.norm(ways, axis=1)[:, np.newaxis]
        return directions

    def _errors_mm(self, n: int, fault: Fault) -> Floats:
        angles = self._pool[self._rng.integers(0, POOL, n)]
        wrong = self._rng.normal(0.0, ENCODER_RAD * fault.scatter, angles.shape)
        for order, (cosine, sine) in enumerate(self._own, 1):
            wrong += cosine * np.cos(order * angles) + sine * np.sin(order * angles)
        wrong[:, 2] += fault.eccentricity_rad * np.cos(angles[:, 2])
        moved = probe_centre(self._geometry, angles + wrong)
        contact = self._rng.normal(0.0, CONTACT_MM * fault.scatter, (n, 3))
        errors: Floats = moved - probe_centre(self._geometry, angles) + contact
        return errors


def _touched(places_mm: Floats) -> ArtefactTouches:
    n = len(places_mm)
    return ArtefactTouches(places_mm, ("",) * n, np.full(n, np.nan), np.full(n, TIP_MM))


@dataclass(frozen=True, slots=True)
class Year:
    """Alarms of a year.

    Attributes:
        alarms: By figure and rule, on which checks.
        spat_2s_mm: On the first and the last day.
    """

    alarms: dict[tuple[str, str], list[int]]
    spat_2s_mm: tuple[float, float]

    def warned(self) -> list[int]:
        """Return checks with any alarm."""
        return sorted({day for days in self.alarms.values() for day in days})

    def beginnings(self) -> int:
        """Return the number of warnings whose preceding check raised none."""
        return _beginnings(self.warned())


def _beginnings(days: list[int]) -> int:
    return sum(day - 1 not in days for day in days)


def year(seed: int, fault: Callable[[int], Fault]) -> Year:
    arm = CheckedArm(seed)
    checks = [arm.check(fault(day)) for day in range(CHECKS)]
    alarms: dict[tuple[str, str], list[int]] = {}
    for kind in KINDS:
        values = [float(getattr(check, kind.key)) for check in checks]
        for day, point in enumerate(charted(values, positive=kind.positive)):
            for name in point.alarms:
                alarms.setdefault((kind.key, name), []).append(day)
    means = [
        float(np.mean([check.spat_2s_mm for check in part]))
        for part in (checks[:BEGINS], checks[-BEGINS:])
    ]
    return Year(alarms, (means[0], means[1]))


def lines(years: int) -> Iterator[str]:
    """Results of all scenarios."""
    for place, (name, fault) in enumerate(SCENARIOS.items()):
        n = years if place == 0 else max(1, years // 3)
        all_years = [year(1000 * place + seed, fault) for seed in range(n)]
        first, last = np.mean([a_year.spat_2s_mm for a_year in all_years], axis=0)
        yield f"{name} ({n} years; 2 s {1e3 * first:.1f} to {1e3 * last:.1f} um)"
        yield from _false(all_years) if place == 0 else _found(all_years)


def _false(years: list[Year]) -> Iterator[str]:
    """Yield false alarms: checks with any, and by rule beside the computed rate."""
    yield f"  {np.mean([a_year.beginnings() for a_year in years]):.2f} warnings a year"
    for kind in KINDS:
        for rule in rules("above" if kind.positive else "both"):
            key = kind.key, rule.name
            days = sum(_beginnings(a_year.alarms.get(key, [])) for a_year in years)
            rate = days / (CHECKS * len(years))
            yield (
                f"  {kind.key}, {rule.name}: {rate:.3%} of checks, computed "
                f"{rule.rate:.3%}"
            )


def _found(years: list[Year]) -> Iterator[str]:
    """Yield after how many checks a fault is found, and by which figure."""
    after = [
        next((day - BEGINS + 1 for day in a_year.warned() if day >= BEGINS), CHECKS)
        for a_year in years
    ]
    low, middle, high = np.percentile(after, [10, 50, 90])
    seen = sum(count <= CHECKS - BEGINS for count in after)
    yield (
        f"  found in {seen} of {len(years)} years, after {middle:.0f} checks (median; "
        f"{low:.0f} to {high:.0f} in eight of ten)"
    )


def main(years: int = YEARS) -> None:
    for line in lines(years):
        print(line, flush=True)


if __name__ == "__main__":
    run_main(main)
