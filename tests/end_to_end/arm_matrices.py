"""Forward kinematics with 4x4 matrices, from an arm file's text alone.

Independent of kinematics/: frames along the chain instead of rotated vectors, and
Rodrigues' formula instead of quaternions.
"""

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np


class MatrixArm:
    """An arm file as a chain of homogeneous transforms."""

    def __init__(self, path: Path) -> None:
        self._file: dict[str, Any] = tomllib.loads(path.read_text("utf-8"))
        self._joints: list[dict[str, Any]] = self._file["joints"]

    def angles_rad(self, counts: Sequence[int]) -> list[float]:
        turns = zip(counts, self._joints, strict=True)
        return [
            j["encoder"]["sign"] * c / j["encoder"]["counts_per_turn"] * math.tau
            for c, j in turns
        ]

    def pose(self, counts: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        frame = _shifted(self._file["origin_mm"])
        for angle_rad, joint in zip(self.angles_rad(counts), self._joints, strict=True):
            turn_rad = angle_rad - joint["zero_rad"]
            frame = (
                frame @ _turned(joint["axis"], turn_rad) @ _shifted(joint["link_mm"])
            )
        probe = self._file["probe"]
        centre = frame @ np.array([*probe["vector_mm"], 1.0])
        shank = np.array(probe["direction"]) / np.linalg.norm(probe["direction"])
        return centre[:3], frame[:3, :3] @ shank

    def resolution_mm(self) -> float:
        """How far one count of every joint together can move the ball, at most."""
        reach_mm = sum(np.linalg.norm(j["link_mm"]) for j in self._joints)
        reach_mm += np.linalg.norm(self._file["probe"]["vector_mm"])
        steps = [math.tau / j["encoder"]["counts_per_turn"] for j in self._joints]
        return float(reach_mm * sum(steps))


def _shifted(vector_mm: Sequence[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = vector_mm
    return matrix


def _turned(axis: Sequence[float], angle_rad: float) -> np.ndarray:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle_rad) * cross
    matrix[:3, :3] += (1.0 - math.cos(angle_rad)) * cross @ cross
    return matrix
