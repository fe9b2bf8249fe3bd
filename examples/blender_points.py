"""Points of an arm as vertices in Blender, while they are taken.

In Blender: open it in the text editor and run it; once more begins anew. Without a
window, until two seconds pass without a point, and saved as ARM.blend:

    TRAVERSE_ARM=bench-7 blender --background --python examples/blender_points.py

One object for each label; what is in doubt is in an object of its own. Blender's unit
is the metre: a part has its true size.
"""

from __future__ import annotations

import os
import site
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from traverse import BlockingArm, Point

try:
    import bpy
except ModuleNotFoundError:
    bpy = None

ARM = os.environ.get("TRAVERSE_ARM", "bench-7")
BROKER = os.environ.get("TRAVERSE_BROKER", "localhost")
COORDINATES = os.environ.get("TRAVERSE_COORDINATES", "xyz_mm")  # or surface_mm, ...
PACKAGES = os.environ.get("TRAVERSE_PACKAGES")  # folder with traverse, if not here
PERIOD_S = 0.5
IDLE_S = 2.0
M_PER_MM = 1e-3


class Standing:
    """Places of points that were not taken back [m], by group."""

    def __init__(self) -> None:
        self._of_id: dict[str, tuple[str, tuple[float, ...]]] = {}
        self.left_out = 0

    def take(self, point: Point) -> None:
        """Add a point, or take one back."""
        place = getattr(point, COORDINATES)
        if point.retracts is not None:
            self._of_id.pop(point.retracts, None)
        elif place is None:
            self.left_out += 1  # surface_mm needs compensation, part_... an alignment
        else:
            label = filter(None, (point.label.artefact, point.label.feature))
            group = " ".join(label) if point.quality.ok else "in doubt"
            place_m = tuple(M_PER_MM * length for length in place)
            self._of_id[point.id] = (group or "points", place_m)

    def groups(self) -> dict[str, list[tuple[float, ...]]]:
        """Places by the group's name."""
        places_of: dict[str, list[tuple[float, ...]]] = {}
        for group, place in self._of_id.values():
            places_of.setdefault(group, []).append(place)
        return places_of


class Follower:
    """Draws an arm's points into a collection of the scene."""

    def __init__(self, arm: BlockingArm) -> None:
        self.arm = arm
        self.standing = Standing()
        self.collection = bpy.data.collections.new(ARM)
        bpy.context.scene.collection.children.link(self.collection)
        self.meshes = {}

    def follow(self, idle_s: float) -> int:
        """Draw the points received, until none comes for so long; their number."""
        new = list(self.arm.points(idle_timeout_s=idle_s))
        for point in new:
            self.standing.take(point)
        if new:
            self.draw()
        return len(new)

    def draw(self) -> None:
        """Update the meshes from the points."""
        groups = self.standing.groups()
        for name in {*groups, *self.meshes}:
            if name not in self.meshes:
                self.meshes[name] = bpy.data.meshes.new(name)
                body = bpy.data.objects.new(name, self.meshes[name])
                self.collection.objects.link(body)
            self.meshes[name].clear_geometry()
            self.meshes[name].from_pydata(groups.get(name, []), [], [])
            self.meshes[name].update()
        for name, places in groups.items():
            print(f"{name}: {len(places)} points")
        if self.standing.left_out:
            print(f"{self.standing.left_out} points without {COORDINATES}")

    def follow_in_window(self) -> float | None:
        """For Blender's timer: draw new points, and come again."""
        if bpy.app.driver_namespace.get("traverse") is not self:
            return None  # it was begun anew
        self.follow(0.02)
        return PERIOD_S


def main() -> None:
    if bpy is None:
        sys.exit("blender_points.py is a script for Blender: run it there")
    if PACKAGES:
        site.addsitedir(PACKAGES)
    try:
        from traverse import BlockingArm, ClientError  # noqa: PLC0415 - may be absent
    except ModuleNotFoundError as error:
        version = ".".join(map(str, sys.version_info[:2]))
        print(f"{error}; set PACKAGES to where Python {version} has traverse-cmm")
        return  # sys.exit would end Blender
    try:
        arm = BlockingArm(ARM, BROKER, since="session").__enter__()
    except ClientError as error:
        print(error)
        return
    follower = Follower(arm)
    if bpy.app.background:
        while follower.follow(IDLE_S):
            pass
        arm.__exit__(None, None, None)
        bpy.ops.wm.save_as_mainfile(filepath=f"{os.getcwd()}/{ARM}.blend")
        return
    before = bpy.app.driver_namespace.get("traverse")
    if before is not None:
        before.arm.__exit__(None, None, None)
    bpy.app.driver_namespace["traverse"] = follower
    bpy.app.timers.register(follower.follow_in_window)


if __name__ == "__main__":
    main()
