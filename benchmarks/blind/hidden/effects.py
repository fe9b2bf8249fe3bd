"""Effects to hide: names, draws, plausible sizes.

Sizes are those of the blind test's own yardstick; nothing is shared with the programs
that look for the effects.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Effect, effect_from_table
from traverse.simulator.campaigns.pose_set import PoseSet

Size = float | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class HiddenEffect:
    """One fault of the arm, as an entry of an arm file would state it.

    Attributes:
        kind: of the arm file's effects.
        joint: name, or None for the whole arm.
        fixed: further keys, which do not grow with the effect.
        sizes: keys that do, in their units.
    """

    kind: str
    joint: str | None
    fixed: Mapping[str, Any]
    sizes: Mapping[str, Size]

    def scaled(self, factor: float) -> "HiddenEffect":
        return replace(
            self, sizes={key: _times(size, factor) for key, size in self.sizes.items()}
        )

    @property
    def keys(self) -> dict[str, Any]:
        return {**self.fixed, **self.sizes}

    @property
    def estimable(self) -> dict[str, Size]:
        phase = {key: self.fixed[key] for key in ("phase_rad",) if key in self.fixed}
        return {**self.sizes, **phase}

    @property
    def entry(self) -> Effect:
        joint = {} if self.joint is None else {"joint": self.joint}
        return effect_from_table({"kind": self.kind, **joint, **self.keys})


@dataclass(frozen=True, slots=True)
class _Draw:
    rng: np.random.Generator
    poses: PoseSet
    joint: int

    @property
    def span_s(self) -> float:
        return float(np.ptp(self.poses.around.time_s))

    def amplitudes(self, size: float) -> tuple[float, float]:
        """Draw cosine and sine of any phase."""
        phase_rad = self.rng.uniform(-np.pi, np.pi)
        return size * float(np.cos(phase_rad)), size * float(np.sin(phase_rad))

    def sign(self) -> float:
        return float(self.rng.choice((-1.0, 1.0)))

    def moment(self) -> dict[str, Any]:
        """Draw the time of a step with enough poses on either side."""
        at_s = self.span_s * float(self.rng.uniform(0.15, 0.85))
        return {"at_s": at_s, **self.epoch()}

    def epoch(self) -> dict[str, Any]:
        return {"epoch_utc": self.poses.spec.conditions.start_utc}

    def order(self, orders: tuple[int, ...]) -> int:
        return int(self.rng.choice(orders))

    def direction(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        drawn = self.rng.standard_normal(3)
        return drawn / np.linalg.norm(drawn)

    def vectors(self, size: float, *, along: bool) -> list[tuple[float, ...]]:
        """Draw vectors of cosine and sine, along the joint's axis or across it."""
        axis = np.array(self.poses.arm.joints[self.joint].axis, dtype=np.float64)
        axis /= np.linalg.norm(axis)
        drawn = self.rng.standard_normal((2, 3))
        parts = np.outer(drawn @ axis, axis)
        vectors = parts if along else drawn - parts
        vectors *= size / np.linalg.norm(vectors)
        return [tuple(vector.tolist()) for vector in vectors]


Drawn = tuple[dict[str, Any], dict[str, Size]]


def _cos_sin(size: float, orders: tuple[int, ...] = ()) -> Callable[[_Draw], Drawn]:
    def drawn(draw: _Draw) -> Drawn:
        fixed = {"order": draw.order(orders)} if orders else {}
        cos, sin = draw.amplitudes(size)
        return fixed, {"cos_rad": cos, "sin_rad": sin}

    return drawn


def _either_way(key: str, size: float) -> Callable[[_Draw], Drawn]:
    return lambda draw: ({}, {key: size * draw.sign()})


def _positive(key: str, size: float) -> Callable[[_Draw], Drawn]:
    return lambda _: ({}, {key: size})


def _teeth(draw: _Draw) -> Drawn:
    cycles = float(draw.rng.choice(_CYCLES))
    cos, sin = draw.amplitudes(2e-5)
    return {"cycles": cycles}, {"cos_rad": cos, "sin_rad": sin}


def _drift(draw: _Draw) -> Drawn:
    return draw.epoch(), {"rate_rad_s": 3e-5 / draw.span_s * draw.sign()}


def _slip(draw: _Draw) -> Drawn:
    return draw.moment(), {"step_rad": 5e-5 * draw.sign()}


def _wobble(draw: _Draw) -> Drawn:
    fixed = {"order": draw.order((2, 3, 4))}
    cos, sin = draw.vectors(1e-5, along=False)
    return fixed, {"cos_rad": cos, "sin_rad": sin}


def _runout(draw: _Draw) -> Drawn:
    along = bool(draw.rng.integers(2))
    fixed = {
        "component": "axial" if along else "radial",
        "order": draw.order((1, 2, 3, 4) if along else (2, 3, 4)),
    }
    cos, sin = draw.vectors(0.01, along=along)
    return fixed, {"cos_mm": cos, "sin_mm": sin}


def _lobing(draw: _Draw) -> Drawn:
    phase_rad = float(draw.rng.uniform(-np.pi, np.pi))
    return {"phase_rad": phase_rad}, {"amplitude_mm": 0.005}


def _base_drift(draw: _Draw) -> Drawn:
    rate = 0.03 / draw.span_s * draw.direction()
    return draw.epoch(), {"rate_mm_s": tuple(rate.tolist())}


def _base_step(draw: _Draw) -> Drawn:
    return draw.moment(), {"step_mm": tuple((0.03 * draw.direction()).tolist())}


def _length(draw: _Draw) -> Drawn:
    bars = [p.artefact.id for p in draw.poses.artefacts if p.artefact.kind == BAR]
    return {"artefact": str(draw.rng.choice(bars))}, {"error_ppm": 10.0 * draw.sign()}


BAR = "ball_bar"
# Encoder harmonics above the fourth are rarer.
_ORDERS = (2, 2, 2, 3, 3, 3, 4, 4, 4, 5, 6, 8, 12, 17, 36)
# Of worm, planetary and strain wave gears, and of belts.
_CYCLES = (13.75, 22.4, 40.5, 72.0, 80.0, 101.0, 160.0, 202.0, 318.6)
# On which joint: one, one or all alike, or none.
_ONE, _MAYBE, _NONE = "one", "maybe", "none"
_KINDS: dict[str, tuple[str, Callable[[_Draw], Drawn]]] = {
    "encoder_eccentricity": (_ONE, _cos_sin(3e-5)),
    "encoder_harmonic": (_ONE, _cos_sin(2e-5, _ORDERS)),
    "encoder_scale": (_ONE, _either_way("scale_ppm", 20.0)),
    "encoder_temperature": (_ONE, _either_way("rate_rad_c", 1e-5)),
    "encoder_drift": (_ONE, _drift),
    "count_slip": (_ONE, _slip),
    "encoder_latency": (_MAYBE, _positive("latency_s", 1e-4)),
    "backlash": (_ONE, _positive("half_width_rad", 1e-5)),
    "joint_compliance": (_ONE, _positive("compliance_rad_nm", 1e-5)),
    "bearing_compliance": (_ONE, _positive("compliance_rad_nm", 1e-5)),
    "mount_compliance": (_NONE, _positive("compliance_rad_nm", 1e-5)),
    "thermal_expansion": (_MAYBE, _positive("expansion_per_c", 1e-5)),
    "axis_wobble": (_ONE, _wobble),
    "axis_runout": (_ONE, _runout),
    "probe_radius": (_NONE, _either_way("radius_error_mm", 0.01)),
    "probe_lobing": (_NONE, _lobing),
    "stylus_bending": (_NONE, _positive("compliance_mm_n", 0.01)),
    "base_drift": (_NONE, _base_drift),
    "base_step": (_NONE, _base_step),
    "artefact_length": (_NONE, _length),
    "transmission_error": (_ONE, _teeth),
}
EFFECT_KINDS = tuple(_KINDS)


def drawn_effect(rng: np.random.Generator, poses: PoseSet, kind: str) -> HiddenEffect:
    """Draw an effect of a kind in a plausible size.

    Args:
        rng: Draws the joint, the order, the moment, the direction.
        poses: Where it will be played.
        kind: One of `EFFECT_KINDS`.
    """
    of, drawn = _KINDS[kind]
    joint = int(rng.integers(len(poses.arm.joints)))
    has_joint = of == _ONE or (of == _MAYBE and bool(rng.integers(2)))
    fixed, sizes = drawn(_Draw(rng, poses, joint))
    name = poses.arm.joints[joint].name if has_joint else None
    return HiddenEffect(kind, name, fixed, sizes)


def _times(size: Size, factor: float) -> Size:
    if isinstance(size, tuple):
        return tuple(factor * part for part in size)
    return factor * size
