"""A picture of an arm in its base posture: three views at one scale.

Above the front (looking along +y) and the side (looking along -x), below the top, as on
a drawing; beside it the joints are listed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.text import Annotation

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.forward import joint_positions
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm

_BASE, _LINK, _HINGE, _PROBE = "#2b3136", "#5b6770", "#c8472b", "#1f6fb2"
_FAINT = "#b9c0c6"
_INCHES_WIDE = 11.0
_LINE_POINTS = 17.0

# Left, right and low edge of a label, mm of the drawing.
_Box = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class _View:
    """A direction to look in: components of the arm's system on the paper.

    To the right, upwards, and along the look, 1 if it grows away from the eye.
    """

    title: str
    right: int
    up: int
    away: int


_FRONT = _View("front", right=0, up=2, away=1)
_SIDE = _View("side", right=1, up=2, away=-1)
_TOP = _View("top", right=0, up=1, away=-1)


def draw_base_posture(arm: Arm, path: Path) -> None:
    """Write the picture as PNG.

    Raises:
        OSError: The file cannot be written.
    """
    geometry = geometry_from_arm(arm)
    skeleton_mm = joint_positions(geometry, geometry.zeros_rad[np.newaxis])[0]
    low_mm, high_mm = skeleton_mm.min(axis=0), skeleton_mm.max(axis=0)
    size_mm = max(float(np.max(high_mm - low_mm)), arm.probe.radius_mm, 1e-3)
    low_mm, high_mm = low_mm - 0.2 * size_mm, high_mm + 0.2 * size_mm
    x, y, z = high_mm - low_mm
    # Titles and scales take two inches each way; the rest is at one scale.
    drawn_inches = _INCHES_WIDE - 2.0
    figure = Figure(
        figsize=(_INCHES_WIDE, drawn_inches * (y + z) / (x + y) + 2.0),
        layout="compressed",
    )
    FigureCanvasAgg(figure)
    figure.suptitle(f"{arm.name}: base posture, mm", fontsize=13, fontweight="bold")
    panels = figure.subplots(2, 2, width_ratios=(x, y), height_ratios=(z, y))
    points_per_mm = 72.0 * drawn_inches / float(x + y)
    names = [joint.name for joint in arm.joints]
    radius_mm = max(arm.probe.radius_mm, 0.008 * size_mm)
    scene = _Scene(names, geometry, skeleton_mm, radius_mm, size_mm, points_per_mm)
    for panel, view in (
        (panels[0, 0], _FRONT),
        (panels[0, 1], _SIDE),
        (panels[1, 0], _TOP),
    ):
        panel.set_xlim(low_mm[view.right], high_mm[view.right])
        panel.set_ylim(low_mm[view.up], high_mm[view.up])
        scene.draw(panel, view)
    _explain(panels[1, 1])
    figure.savefig(path, format="png", dpi=130)


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """An arm ready to be drawn from any side."""

    names: Sequence[str]
    geometry: Geometry
    skeleton_mm: Floats
    radius_mm: float
    size_mm: float
    points_per_mm: float

    def draw(self, panel: Axes, view: _View) -> None:
        """Draw the arm as it looks from one side."""
        flat = [view.right, view.up]
        joints_mm = self.skeleton_mm[:-1][:, flat]
        probe_mm = self.geometry.probe_vector_mm
        ball_mm = self.skeleton_mm[-1][flat]
        end_mm = (self.skeleton_mm[-1] - probe_mm)[flat]
        panel.set_aspect("equal")
        panel.set_title(view.title, loc="left", fontsize=10)
        panel.set_xlabel("xyz"[view.right])
        panel.set_ylabel("xyz"[view.up])
        panel.grid(color="#e6e9eb", linewidth=0.6)
        panel.set_axisbelow(True)
        body = np.vstack([joints_mm, end_mm])
        panel.plot(*body.T, color=_LINK, linewidth=5.0, solid_capstyle="round")
        panel.plot(*np.vstack([end_mm, ball_mm]).T, color=_PROBE, linewidth=2.0)
        panel.plot(*joints_mm[0], marker="s", markersize=13, color=_BASE)
        for joint_mm, axis in zip(joints_mm, self.geometry.axes, strict=True):
            self._draw_hinge(panel, view, joint_mm, axis)
        panel.add_patch(Circle(tuple(ball_mm), self.radius_mm, color=_PROBE, zorder=5))
        shank = self.geometry.probe_direction[flat]
        # Not where the shank lies along the probe's line.
        along_mm = self.geometry.probe_direction @ probe_mm
        is_apart = along_mm < 0.99 * np.linalg.norm(probe_mm) + 1e-9
        if is_apart and np.linalg.norm(shank) > 0.2:
            tail_mm = ball_mm - 0.12 * self.size_mm * shank
            _arrow(panel, tail_mm, ball_mm, {"color": _PROBE, "alpha": 0.55})
        self._label(panel, joints_mm, ball_mm)

    def _draw_hinge(
        self, panel: Axes, view: _View, joint_mm: Floats, axis: Floats
    ) -> None:
        flat = axis[[view.right, view.up]]
        if np.linalg.norm(flat) > 0.2:
            half_mm = 0.06 * self.size_mm * flat
            look = {"color": _HINGE, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
            ends_mm = joint_mm - half_mm, joint_mm + 1.4 * half_mm
            _arrow(panel, *ends_mm, look).set_zorder(4)
            panel.plot(*joint_mm, marker="o", markersize=4, color=_HINGE, zorder=4)
            return
        panel.plot(
            *joint_mm,
            marker="o",
            markersize=10,
            markerfacecolor="white",
            markeredgecolor=_HINGE,
            markeredgewidth=1.6,
            zorder=4,
        )
        away = 3 - view.right - view.up
        mark = "x" if axis[away] * view.away > 0.0 else "."
        panel.plot(*joint_mm, marker=mark, markersize=5, color=_HINGE, zorder=5)

    def _label(self, panel: Axes, joints_mm: Floats, ball_mm: Floats) -> None:
        """Write names beside the joints; those at one place share a label."""
        occupied: list[_Box] = []
        for members in _groups(joints_mm, 0.05 * self.size_mm):
            text = _spoken([self.names[k] for k in members])
            self._write(panel, text, joints_mm[members].mean(axis=0), 13.0, occupied)
        self._write(panel, "ball", ball_mm, -15.0, occupied)

    def _write(
        self,
        panel: Axes,
        text: str,
        place_mm: Floats,
        rise_points: float,
        occupied: list[_Box],
    ) -> None:
        """Write beside a place where it fits, and further off where that is taken."""
        width_mm = (6.0 * len(text) + 14.0) / self.points_per_mm
        height_mm = 0.9 * _LINE_POINTS / self.points_per_mm
        to_right = place_mm[0] + width_mm < panel.get_xlim()[1]
        left_mm = place_mm[0] - (0.0 if to_right else width_mm)
        while any(
            left_mm < right and left < left_mm + width_mm and abs(up - low) < height_mm
            for up in [place_mm[1] + rise_points / self.points_per_mm]
            for left, right, low in occupied
        ):
            rise_points += float(np.copysign(_LINE_POINTS, rise_points))
        low_mm = place_mm[1] + rise_points / self.points_per_mm
        occupied.append((left_mm, left_mm + width_mm, low_mm))
        panel.annotate(
            text,
            xy=tuple(place_mm),
            xytext=(9 if to_right else -9, rise_points),
            textcoords="offset points",
            horizontalalignment="left" if to_right else "right",
            fontsize=9,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": _FAINT},
            arrowprops={"arrowstyle": "-", "color": _LINK, "linewidth": 0.7},
            zorder=6,
        )


def _arrow(
    panel: Axes, tail_mm: Floats, tip_mm: Floats, look: dict[str, Any]
) -> Annotation:
    style = {"arrowstyle": "-|>", **look}
    return panel.annotate("", tuple(tip_mm), tuple(tail_mm), arrowprops=style)


def _groups(places_mm: Floats, near_mm: float) -> Sequence[list[int]]:
    """Gather the places that are near the first one of their group."""
    groups: list[list[int]] = []
    for k, place_mm in enumerate(places_mm):
        for group in groups:
            if np.linalg.norm(places_mm[group[0]] - place_mm) < near_mm:
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _spoken(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) < 4 else f"{names[0]} ... {names[-1]}"


def _explain(panel: Axes) -> None:
    """Return what the signs of the drawing mean."""
    panel.set_axis_off()
    panel.legend(
        handles=[
            Line2D([], [], color=_LINK, linewidth=5, label="link"),
            _sign("s", _BASE, "base, x_0"),
            Line2D([], [], color=_HINGE, linewidth=1.6, label="axis of a hinge"),
            _sign(r"$\odot$", _HINGE, "axis towards the eye"),
            _sign(r"$\otimes$", _HINGE, "axis away from the eye"),
            Line2D([], [], color=_PROBE, linewidth=2, label="probe and its shank"),
        ],
        loc="center",
        frameon=False,
        fontsize=10,
    )


def _sign(marker: str, color: str, label: str) -> Line2D:
    return Line2D(
        [], [], linestyle="", marker=marker, markersize=9, color=color, label=label
    )
