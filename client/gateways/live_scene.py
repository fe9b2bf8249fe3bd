"""An arm and its points as entities of Foxglove's 3D panel, in metres.

Colours and shapes: what may be trusted is blue, a point a cross; what is in doubt is
orange, a point a box with its quality flags beside it.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from foxglove import messages as fox

from traverse.client.display.figures import COVERAGE_FACTOR, flag_words
from traverse.client.exports.ros_messages import joint_names
from traverse.kinematics.helmert.transformation import quaternion_of
from traverse.protocol.messages import Live, Point
from traverse.protocol.messages.point import Covariance
from traverse.recording.views import FRAME, turn_of_x_onto

M = 1e-3  # of a millimetre
BALL_FRAME = "ball"
BLUE, FAINT_BLUE = (fox.Color(r=0.1, g=0.45, b=0.9, a=a) for a in (1.0, 0.35))
ORANGE, FAINT_ORANGE = (fox.Color(r=1.0, g=0.5, b=0.0, a=a) for a in (1.0, 0.35))
MARK_MM = 1.0  # half a mark's width
JOINT_MM = 20.0
_CROSS = [np.eye(3)[axis] * side for axis in range(3) for side in (-1, 1)]
_CORNERS = [np.array([i, j, k]) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
_BOX = [
    corner
    for a in _CORNERS
    for b in _CORNERS
    if np.sum(a != b) == 1 and tuple(a) < tuple(b)
    for corner in (a, b)
]


def point_entity(point: Point, times: float) -> fox.SceneEntity:
    """Return a mark at the ball's centre, and its covariance's ellipsoid, k = 2."""
    ok = point.quality.ok
    colour = BLUE if ok else ORANGE
    centre_mm = np.array(point.xyz_mm)
    mark = _lines(
        (centre_mm + MARK_MM * end for end in (_CROSS if ok else _BOX)),
        fox.LinePrimitiveLineType.LineList,
        colour,
    )
    doubt_texts = [] if ok else [_text(point.xyz_mm, flag_words(point), colour)]
    return _entity(
        point.id,
        point.time_ns,
        spheres=_ellipsoid(point.xyz_mm, point.covariance_mm2, times, ok=ok),
        lines=[mark],
        texts=doubt_texts,
        metadata={
            "seq": str(point.seq),
            "artefact": point.label.artefact or "",
            "ok": str(ok).lower(),
            "flags": ", ".join(point.quality.flags),
            "coverage factor k": f"{COVERAGE_FACTOR:g}",
            "ellipsoid magnified": f"{times:g}",
        },
    )


def arm_entity(live: Live, times: float) -> fox.SceneEntity:
    """Return links, joints, the ball in its size, and the ellipsoid.

    Without `skeleton_mm` the ball alone.
    """
    ok = live.quality.ok
    colour = BLUE if ok else ORANGE
    skeleton_mm = live.skeleton_mm or ()
    spheres = [
        _sphere(place_mm, np.full(3, JOINT_MM), colour) for place_mm in skeleton_mm[:-1]
    ]
    spheres.append(_sphere(live.xyz_mm, np.full(3, 2 * live.probe_radius_mm), colour))
    return _entity(
        "arm",
        live.time_ns,
        spheres=spheres + _ellipsoid(live.xyz_mm, live.covariance_mm2, times, ok=ok),
        lines=[
            _lines(
                map(np.array, skeleton_mm), fox.LinePrimitiveLineType.LineStrip, colour
            )
        ],
        texts=[] if ok else [_text(live.xyz_mm, flag_words(live), colour)],
        metadata={"ok": str(ok).lower(), "flags": ", ".join(live.quality.flags)},
    )


def joint_states(live: Live, names: Sequence[str]) -> fox.JointStates:
    """Return the readings of the joints."""
    names = joint_names(names, len(live.angles_rad))
    return fox.JointStates(
        timestamp=_time(live.time_ns),
        joints=[
            fox.JointState(name=name, position=angle_rad)
            for name, angle_rad in zip(names, live.angles_rad, strict=True)
        ],
    )


def ball_frame(live: Live) -> fox.FrameTransform:
    """Return the frame of the ball; its x axis is the shank, as of a point's pose."""
    x, y, z = (value * M for value in live.xyz_mm)
    return fox.FrameTransform(
        timestamp=_time(live.time_ns),
        parent_frame_id=FRAME,
        child_frame_id=BALL_FRAME,
        translation=fox.Vector3(x=x, y=y, z=z),
        rotation=fox.Quaternion(**turn_of_x_onto(live.ijk)),
    )


def deletion(entity_id: str, utc_ns: int) -> fox.SceneEntityDeletion:
    kind = fox.SceneEntityDeletionType.MatchingId
    return fox.SceneEntityDeletion(timestamp=_time(utc_ns), type=kind, id=entity_id)


def _ellipsoid(
    xyz_mm: Sequence[float],
    covariance_mm2: Covariance | None,
    times: float,
    *,
    ok: bool,
) -> list[fox.SpherePrimitive]:
    """Return the ellipsoid within k standard deviations in each direction."""
    if covariance_mm2 is None:
        return []
    xx, xy, xz, yy, yz, zz = covariance_mm2
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    variances, axes = np.linalg.eigh(matrix)
    axes[:, 0] *= np.linalg.det(axes)  # a turn, no mirror image
    size_mm = 2 * times * COVERAGE_FACTOR * np.sqrt(np.maximum(variances, 0.0))
    w, x, y, z = quaternion_of(axes).tolist()
    turn = fox.Quaternion(x=x, y=y, z=z, w=w)
    return [_sphere(xyz_mm, size_mm, FAINT_BLUE if ok else FAINT_ORANGE, turn)]


def _sphere(
    xyz_mm: Sequence[float],
    size_mm: np.ndarray,
    colour: fox.Color,
    turn: fox.Quaternion | None = None,
) -> fox.SpherePrimitive:
    x, y, z = (size_mm * M).tolist()
    size = fox.Vector3(x=x, y=y, z=z)
    return fox.SpherePrimitive(pose=_pose(xyz_mm, turn), size=size, color=colour)


def _lines(
    ends_mm: Iterable[np.ndarray], kind: fox.LinePrimitiveLineType, colour: fox.Color
) -> fox.LinePrimitive:
    points = [fox.Point3(x=x, y=y, z=z) for x, y, z in (end * M for end in ends_mm)]
    return fox.LinePrimitive(
        type=kind,
        pose=_pose((0.0, 0.0, 0.0)),
        thickness=2.0,  # pixels
        scale_invariant=True,
        points=points,
        color=colour,
    )


def _text(xyz_mm: Sequence[float], text: str, colour: fox.Color) -> fox.TextPrimitive:
    x, y, z = xyz_mm
    return fox.TextPrimitive(
        pose=_pose((x, y, z + 4 * MARK_MM)),
        billboard=True,
        font_size=14.0,  # pixels
        scale_invariant=True,
        color=colour,
        text=text,
    )


def _pose(xyz_mm: Sequence[float], turn: fox.Quaternion | None = None) -> fox.Pose:
    x, y, z = (value * M for value in xyz_mm)
    turn = turn or fox.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    return fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=turn)


def _entity(
    entity_id: str,
    utc_ns: int,
    *,
    spheres: list[fox.SpherePrimitive],
    lines: list[fox.LinePrimitive],
    texts: list[fox.TextPrimitive],
    metadata: dict[str, str],
) -> fox.SceneEntity:
    return fox.SceneEntity(
        timestamp=_time(utc_ns),
        frame_id=FRAME,
        id=entity_id,
        lifetime=fox.Duration(sec=0),
        frame_locked=True,
        metadata=[fox.KeyValuePair(key=key, value=v) for key, v in metadata.items()],
        spheres=spheres,
        lines=lines,
        texts=texts,
    )


def _time(utc_ns: int) -> fox.Timestamp:
    return fox.Timestamp(sec=utc_ns // 10**9, nsec=utc_ns % 10**9)
