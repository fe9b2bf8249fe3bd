"""The 3D view of the arm; drawn in the browser."""

from collections.abc import Mapping

import numpy as np
from nicegui import ui
from nicegui.element import Element

from traverse.arrays import Floats
from traverse.protocol.messages import Live, Point

# Its module contains three.js.
assert ui.scene is not None  # noqa: S101 - imported for its registration

SEEN_MM = 0.02  # less than a pixel, however near one looks


class ArmScene(Element, component="arm_scene.js", default_classes="arm-scene-box"):
    """Skeleton, probe, points and cloud.

    Args:
        cloud_url: source of scanned points for the browser.
    """

    def __init__(self, cloud_url: str) -> None:
        super().__init__()
        self._props["cloudUrl"] = cloud_url
        self._shown: tuple[Floats, float] | None = None
        self._drawn: dict[str, bool] = {}  # whether a point is ok, by id

    def show_pose(self, live: Live) -> None:
        if live.skeleton_mm is None:
            return
        places_mm = np.array(live.skeleton_mm)
        if self._shown is not None and live.probe_radius_mm == self._shown[1]:
            was_mm = self._shown[0]
            if (
                places_mm.shape == was_mm.shape
                and np.abs(places_mm - was_mm).max() < SEEN_MM
            ):
                return
        self._shown = (places_mm, live.probe_radius_mm)
        self.run_method("pose", places_mm.tolist(), live.probe_radius_mm)

    def forget(self) -> None:
        """Send everything anew: the browser was reloaded."""
        self._shown, self._drawn = None, {}

    def show_points(self, points: Mapping[str, Point]) -> None:
        """Show these points, by id, and no others; only changes are sent."""
        if removed_ids := self._drawn.keys() - points.keys():
            self.run_method("remove_points", sorted(removed_ids))
        drawn, self._drawn = self._drawn, {i: p.quality.ok for i, p in points.items()}
        if new := [p for i, p in points.items() if drawn.get(i) != p.quality.ok]:
            self.run_method(
                "add_points", [[p.id, *p.xyz_mm, p.quality.ok] for p in new]
            )

    def show_cloud(self, version: int) -> None:
        self.run_method("update_cloud", version)

    def view(self, name: str) -> None:
        """Look from a standard side: iso, top, front, right, or at the probe."""
        self.run_method("view", name)

    def theme(self, *, dark: bool) -> None:
        self.run_method("theme", dark)

    def show_age(self, *, is_stale: bool) -> None:
        """Grey the arm while its pose is out of date."""
        self.run_method("show_age", is_stale)
