"""Tables of a campaign's poses, a line a pose."""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from traverse.arrays import Floats
from traverse.lab.campaign.campaign import Campaign


def write_poses(
    path: Path,
    campaign: Campaign,
    header: Sequence[str],
    cells: Callable[[int], list[str]],
) -> None:
    """Write a CSV table of a campaign's poses: what was touched, and further cells."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["line", "artefact", "feature", *header])
        writer.writerows(
            [line, *campaign.touched_cells(at), *cells(at)]
            for at, line in enumerate(campaign.poses.lines.tolist())
        )


def texts(numbers: Floats) -> list[str]:
    """Write numbers as cells, empty for NaN."""
    return ["" if np.isnan(number) else f"{number:.6g}" for number in numbers]
