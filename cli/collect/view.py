"""Display of a running collection: a picture, or lines in a pipe."""

from collections.abc import Sequence

import numpy as np
from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from traverse.lab.collection.collection import Collection
from traverse.lab.collection.figures import SECTORS, agreement, coverage, picture
from traverse.lab.collection.plan import Target, volume_picture

ROWS_SHOWN = 15
KEYS = "n next   p previous   u undo   q quit"


def shown(
    collection: Collection,
    current: Target | None,
    remarks: Sequence[str],
    question: str,
) -> RenderableType:
    targets = Table(box=None, pad_edge=False)
    for title in ("", "artefact", "done", "", "agreement"):
        targets.add_column(title)
    for target in _around(collection.targets, current):
        done = collection.count(target)
        mark = "▶" if target == current else "✓" if done >= target.wanted else " "
        targets.add_row(
            mark,
            f"{target} ({target.kind})",
            f"{done} of {target.wanted}",
            ProgressBar(total=target.wanted, completed=done, width=20),
            agreement(collection, target.artefact, target.kind),
        )
    joints = Table(box=None, pad_edge=False)
    for title in ("joint", "0 to 360 degrees of its reading", "turned"):
        joints.add_column(title)
    counts = coverage(list(collection.touches.values()), len(collection.joint_names))
    for name, sectors in zip(collection.joint_names, counts, strict=True):
        part = np.count_nonzero(sectors) / SECTORS
        joints.add_row(name, f"│{picture(sectors)}│", f"{part:.0%}")
    volume = Table(box=None, pad_edge=False)
    for title in ("working volume", "its eight octants"):
        volume.add_column(title)
    for shell, marks in volume_lines(collection):
        volume.add_row(shell, f"│{marks}│")
    spaced: list[RenderableType] = [Text(), volume] if volume.row_count else []
    return Group(
        Text(question or instruction(collection, current), style="bold"),
        Text(),
        targets,
        Text(),
        joints,
        *spaced,
        Text(),
        *(Text(line) for line in remarks),
        Text(KEYS, style="dim"),
    )


def instruction(collection: Collection, current: Target | None) -> str:
    if current is None:
        return "All touches are complete. Press q to end, or continue."
    left = max(0, current.wanted - collection.count(current))
    if current.say:
        return f"{current}: {current.say}. {left} more."
    counts = coverage(list(collection.touches.values()), len(collection.joint_names))
    least = int(np.count_nonzero(counts, axis=1).argmin())
    hint = f"turn {collection.joint_names[least]} to where it has not been yet"
    return f"Touch {current} ({current.kind}): {left} more; {hint}."


def summary(collection: Collection) -> list[str]:
    lines = []
    for artefact in collection.file.artefacts:
        # Of a repeated feature the last target counts all.
        by_feature = {
            t.feature: t for t in collection.targets if t.artefact == artefact.id
        }
        targets = list(by_feature.values())
        done = ", ".join(
            f"{f'feature {t.feature}: ' if t.feature else ''}{collection.count(t)}"
            f" of {t.wanted}"
            for t in targets
        )
        figure = agreement(collection, artefact.id, artefact.kind)
        lines.append(f"{artefact.id}: {done}" + (f"; {figure}" if figure else ""))
    counts = coverage(list(collection.touches.values()), len(collection.joint_names))
    turned = ", ".join(
        f"{name} {np.count_nonzero(sectors) / SECTORS:.0%}"
        for name, sectors in zip(collection.joint_names, counts, strict=True)
    )
    shells = volume_lines(collection)
    volume = [f"touched at {shell}: {marks}" for shell, marks in shells]
    return [*lines, f"turned: {turned}", *volume]


def volume_lines(collection: Collection) -> list[tuple[str, str]]:
    """Touched parts of the working volume, if a plan states it."""
    if collection.plan is None:
        return []
    places_mm = [touch.xyz_mm for touch in collection.touches.values()]
    return volume_picture(places_mm, collection.plan)


def _around(targets: Sequence[Target], current: Target | None) -> Sequence[Target]:
    """A window of a long list, with the current one in it."""
    if len(targets) <= ROWS_SHOWN or current is None:
        return targets[-ROWS_SHOWN:]
    first = max(0, targets.index(current) - ROWS_SHOWN // 3)
    return targets[first : first + ROWS_SHOWN]
