"""A gauge to be printed: a block with two conical sockets, as a mesh and a campaign.

The walls of a socket are at 45 degrees and touch the ball on a circle, so that its
centre lies on the socket's axis and in the top face; half of all directions are free
for the shank. Below the ball is a gap, as a printed tip is round.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats

WALL_MM = 3.0
SEGMENTS = 96  # of a circle; a multiple of 8, so that corners of squares are among them
LEAST_FLOOR_MM = 0.2  # radius

Vertex = tuple[float, float, float]


def rounding_rad(counts_per_turn: Iterable[int]) -> float | None:
    """Return the standard deviation of readings by the coarsest encoder's counts.

    A rounding error is uniform over a count: its deviation is a count over sqrt(12).
    None without any encoder.
    """
    coarsest = min(counts_per_turn, default=None)
    return None if coarsest is None else 2.0 * math.pi / (coarsest * math.sqrt(12.0))


@dataclass(frozen=True, slots=True)
class SocketGauge:
    """Two sockets.

    Attributes:
        distance_mm: between the centres of a ball in either.
        ball_mm: diameter of the ball.
        clearance_mm: gap below the ball.

    Raises:
        ValueError: there is no such gauge; the text says why.
    """

    distance_mm: float
    ball_mm: float
    clearance_mm: float

    def __post_init__(self) -> None:
        most_mm = (math.sqrt(2.0) - 1.0) * self.ball_mm / 2.0 - LEAST_FLOOR_MM
        if not 0.0 <= self.clearance_mm <= most_mm:  # nor where one is no number
            raise ValueError(
                f"a clearance of {self.clearance_mm:g} mm below a ball of "
                f"{self.ball_mm:g} mm; expected 0 to {max(0.0, most_mm):.2f} mm"
            )
        if not self.width_mm < self.distance_mm < math.inf:
            raise ValueError(
                f"a distance of {self.distance_mm:g} mm is too short for balls of "
                f"{self.ball_mm:g} mm; expected more than {self.width_mm:.1f} mm"
            )

    @property
    def rim_mm(self) -> float:
        """Radius of a socket in the top face."""
        return math.sqrt(2.0) * self.ball_mm / 2.0

    @property
    def depth_mm(self) -> float:
        """Of the sockets' floors below the top face."""
        return self.ball_mm / 2.0 + self.clearance_mm

    @property
    def width_mm(self) -> float:
        """Of the block, across the line through the sockets."""
        return 2.0 * (self.rim_mm + WALL_MM)

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Length, width, height of the block."""
        length_mm = self.distance_mm + self.width_mm
        return (length_mm, self.width_mm, self.depth_mm + WALL_MM)

    def triangles(self) -> Floats:
        """The closed surface, (n, 3, 3) [mm].

        The middle of the top face is 0, the sockets are at x = -distance / 2 and
        +distance / 2; vertices run counterclockwise, seen from outside.
        """
        polygons = list(self._top())
        # What the top leaves open is its outline, which goes down to the bottom.
        edges = [
            edge
            for polygon in polygons
            for edge in zip(polygon, (*polygon[1:], polygon[0]), strict=True)
        ]
        known = set(edges)
        bottom_mm = -self.size_mm[2]
        middle = (0.0, 0.0, bottom_mm)
        for a, b in edges:
            if (b, a) not in known:
                low_a, low_b = (*a[:2], bottom_mm), (*b[:2], bottom_mm)
                polygons += [(b, a, low_a, low_b), (middle, low_b, low_a)]
        return np.array(
            [
                (polygon[0], polygon[k], polygon[k + 1])
                for polygon in polygons
                for k in range(1, len(polygon) - 1)
            ]
        )

    def stl(self) -> bytes:
        """The surface as a binary STL file, in millimetres."""
        triangles = self.triangles()
        normals = np.cross(
            triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        )
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        facets = np.zeros(
            len(triangles), dtype=[("numbers", "<f4", (4, 3)), ("unused", "<u2")]
        )
        facets["numbers"] = np.concatenate([normals[:, np.newaxis], triangles], axis=1)
        head = b"Traverse: gauge with two sockets, mm".ljust(80, b" ")
        return head + len(facets).to_bytes(4, "little") + facets.tobytes()

    def campaign(
        self, places: int, distance_std_mm: float, encoder_rad: float | None = None
    ) -> str:
        """Text of a campaign.toml with the gauge in so many places.

        The noise of the readings is stated where it is given; that of a contact is as
        if both sockets were equally uncertain.
        """
        std = f"distance_std_mm = {distance_std_mm}\n"
        noise = f"[noise]\ncontact_mm = {distance_std_mm / math.sqrt(2.0):.2g}\n"
        if encoder_rad is not None:
            noise += (
                "# Rounding to counts of the coarsest encoder, at least.\n"
                f"encoder_rad = {encoder_rad:.3g}\n"
            )
        tables = [
            f'[[artefacts]]\nid = "gauge-{place}"\nkind = "seats"\n'
            f"distance_mm = {self.distance_mm}\n{std}"
            for place in range(1, places + 1)
        ]
        head = (
            "# One gauge, fastened in one place after the other: features 1 and 2 are "
            "its sockets.\n"
            "# Measure the distance of the printed sockets and write it here.\n"
            'schema = "traverse/campaign/1"\nposes = "poses.csv"\n'
        )
        return "\n".join([head, noise, *tables])

    def _top(self) -> Iterator[Sequence[Vertex]]:
        """The top face with its sockets."""
        half_mm = self.width_mm / 2.0
        # Facets touch the ball, not their corners.
        rim_mm = self.rim_mm / math.cos(math.pi / SEGMENTS)
        floor_mm = (self.rim_mm - self.depth_mm) / math.cos(math.pi / SEGMENTS)
        angles = [2.0 * math.pi * k / SEGMENTS for k in range(SEGMENTS)]
        columns: list[list[Vertex]] = []
        for side in (-1.0, 1.0):
            x_mm = side * self.distance_mm / 2.0

            def ring(radii_mm: Sequence[float], z_mm: float, x0: float) -> list[Vertex]:
                return [
                    # Rounded, so that neighbours have the same vertices.
                    (
                        round(x0 + r * math.cos(a), 9),
                        round(r * math.sin(a), 9) + 0.0,
                        z_mm,
                    )
                    for r, a in zip(radii_mm, angles, strict=True)
                ]

            square = ring(
                [half_mm / max(abs(math.cos(a)), abs(math.sin(a))) for a in angles],
                0.0,
                x_mm,
            )
            rim = ring([rim_mm] * SEGMENTS, 0.0, x_mm)
            floor = ring([floor_mm] * SEGMENTS, -self.depth_mm, x_mm)
            for k in range(SEGMENTS):
                n = (k + 1) % SEGMENTS
                yield (rim[k], square[k], square[n], rim[n])
                yield (rim[k], rim[n], floor[n], floor[k])
                yield ((x_mm, 0.0, -self.depth_mm), floor[k], floor[n])
            eighth = SEGMENTS // 8
            facing = (
                [square[k % SEGMENTS] for k in range(-eighth, eighth + 1)]
                if side < 0.0
                else [square[SEGMENTS // 2 - k] for k in range(-eighth, eighth + 1)]
            )
            columns.append(facing)
        left, right = columns
        for k in range(len(left) - 1):
            yield (left[k], right[k], right[k + 1], left[k + 1])
