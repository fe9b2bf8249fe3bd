"""Mixes of artefacts by name, in sizes that suit the arm."""

from collections.abc import Callable, Mapping
from functools import partial

from traverse.simulator.campaigns.artefacts import (
    Artefact,
    BallBar,
    Cone,
    ParallelPlanes,
    Plane,
    Points,
    Sphere,
)

Maker = Callable[[str, int, float], Artefact]  # id, poses, width [mm]


def mix_artefacts(name: str, n_poses: int, width_mm: float) -> tuple[Artefact, ...]:
    """Artefacts of a mix; the poses are dealt out evenly.

    Args:
        name: A key of `MIXES`.
        n_poses: Of all artefacts together; an artefact without poses is left out.
        width_mm: Of the arm's working volume.
    """
    makers = MIXES[name]
    share, rest = divmod(n_poses, len(makers))
    counts = [share + (number < rest) for number in range(len(makers))]
    made = zip(makers.items(), counts, strict=True)
    return tuple(maker(id_, count, width_mm) for (id_, maker), count in made if count)


def _rounded_mm(share: float, width_mm: float) -> float:
    """A length in whole millimetres, as makers of standards like it."""
    return max(1.0, round(share * width_mm))


def _cone(name: str, n_poses: int, _width_mm: float) -> Artefact:
    return Cone(id=name, n_poses=n_poses)


def _bar(name: str, n_poses: int, width_mm: float, share: float = 0.45) -> Artefact:
    return BallBar(
        id=name,
        n_poses=n_poses,
        radius_mm=12.7,
        distance_mm=_rounded_mm(share, width_mm),
        distance_std_mm=0.0005,
    )


def _sphere(name: str, n_poses: int, width_mm: float) -> Artefact:
    return Sphere(id=name, n_poses=n_poses, radius_mm=_rounded_mm(0.03, width_mm))


def _known_sphere(name: str, n_poses: int, width_mm: float) -> Artefact:
    return Sphere(
        id=name,
        n_poses=n_poses,
        radius_mm=_rounded_mm(0.04, width_mm),
        known=True,
        radius_std_mm=0.0002,
    )


def _hollow_sphere(name: str, n_poses: int, width_mm: float) -> Artefact:
    return Sphere(
        id=name, n_poses=n_poses, radius_mm=_rounded_mm(0.05, width_mm), side="inside"
    )


def _plane(name: str, n_poses: int, width_mm: float) -> Artefact:
    return Plane(id=name, n_poses=n_poses, size_mm=_rounded_mm(0.3, width_mm))


def _gauge(name: str, n_poses: int, width_mm: float) -> Artefact:
    return ParallelPlanes(
        id=name,
        n_poses=n_poses,
        distance_mm=_rounded_mm(0.3, width_mm),
        distance_std_mm=0.0005,
        size_mm=_rounded_mm(0.08, width_mm),
    )


def _gap(name: str, n_poses: int, width_mm: float) -> Artefact:
    return ParallelPlanes(
        id=name,
        n_poses=n_poses,
        distance_mm=_rounded_mm(0.2, width_mm),
        distance_std_mm=0.0005,
        size_mm=_rounded_mm(0.08, width_mm),
        side="inside",
    )


def _arm_points(name: str, n_poses: int, width_mm: float) -> Artefact:
    size_mm = _rounded_mm(0.25, width_mm)
    return Points(id=name, n_poses=n_poses, size_mm=size_mm, frame="arm")


def _own_points(name: str, n_poses: int, width_mm: float) -> Artefact:
    size_mm = _rounded_mm(0.25, width_mm)
    return Points(id=name, n_poses=n_poses, size_mm=size_mm, frame="own")


def _scaled_points(name: str, n_poses: int, width_mm: float) -> Artefact:
    size_mm = _rounded_mm(0.25, width_mm)
    return Points(
        id=name, n_poses=n_poses, size_mm=size_mm, frame="own_scaled", scale=1.0005
    )


def _several(name: str, maker: Maker, count: int) -> dict[str, Maker]:
    return {f"{name}-{number + 1}": maker for number in range(count)}


MIXES: Mapping[str, Mapping[str, Maker]] = {
    "cones": _several("cone", _cone, 5),
    "cones+bar": {**_several("cone", _cone, 5), "bar": _bar},
    "bars": {
        **_several("bar", _bar, 4),
        **_several("short-bar", partial(_bar, share=0.25), 2),
    },
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
