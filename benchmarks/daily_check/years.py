"""Simulated years of daily checks, by arms with errors of their own.

The cone and the sphere are touched in other postures each time. An arm is as it was,
drifts from day 51 on, or is knocked that day.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.trials.lines import Line
from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.seats import Cone
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.daily_check.control_chart import charted
from traverse.lab.daily_check.figures import (
    KINDS,
    DailyCheckFigures,
    daily_check_figures,
)
from traverse.lab.measured_points.measurement import ArtefactTouches, Measurement

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
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
            Measurement(self._artefacts, touched, np.zeros(3), 1000.0)
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
class Case:
    """An arm before its year.

    Attributes:
        scenario: Key of `SCENARIOS`.
    """

    scenario: str
    arm: CheckedArm


def drawn_case(scenario: str, seed: int) -> Case:
    return Case(scenario, CheckedArm(seed))


def year(case: Case) -> Line:
    """Check an arm each working day of a year.

    Returns:
        `alarms`: days with an alarm, by figure and then by rule; `spat_2s_mm`: means of
        the first and of the last days.
    """
    fault_on = SCENARIOS[case.scenario]
    checks = [case.arm.check(fault_on(day)) for day in range(CHECKS)]
    alarms: dict[str, dict[str, list[int]]] = {kind.key: {} for kind in KINDS}
    for kind in KINDS:
        values = [float(getattr(check, kind.key)) for check in checks]
        for day, point in enumerate(charted(values, positive=kind.positive)):
            for name in point.alarms:
                alarms[kind.key].setdefault(name, []).append(day)
    means = [
        float(np.mean([check.spat_2s_mm for check in part]))
        for part in (checks[:BEGINS], checks[-BEGINS:])
    ]
    return {"alarms": alarms, "spat_2s_mm": means}
