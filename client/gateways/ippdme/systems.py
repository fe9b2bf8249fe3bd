"""Coordinate systems of I++ DME."""

import numpy as np

from traverse.arrays import Floats
from traverse.client.gateways.ippdme.grammar import IppError

CHAIN = ("MachineCsy", "MoveableMachineCsy", "MultipleArmCsy", "PartCsy")
"""What can be selected, from the machine to the part."""
STORED = ("JogDisplayCsy", "JogMoveCsy", "SensorCsy", *CHAIN[1:])
"""What can be set; the first three have no effect on points."""


class Systems:
    """Transformations, and which system coordinates are given in.

    Attributes:
        selected: one of `CHAIN`.
    """

    def __init__(self) -> None:
        self.selected = CHAIN[0]
        self._values = dict.fromkeys(STORED, (0.0,) * 6)

    def select(self, name: str) -> None:
        """Select a system; raises IppError."""
        if name not in CHAIN:
            raise IppError(509, f"{name}: expected one of {', '.join(CHAIN)}")
        self.selected = name

    def values(self, name: str) -> tuple[float, ...]:
        """X0, Y0, Z0 [mm], theta, psi, phi [degrees]; raises IppError."""
        if name not in STORED:
            raise IppError(509, f"{name}: expected one of {', '.join(STORED)}")
        return self._values[name]

    def set(self, name: str, values: tuple[float, ...]) -> None:
        """Set a transformation by the same six values; raises IppError."""
        self.values(name)
        x, y, z, theta, psi, phi = values
        if not 0.0 <= theta <= 180.0:
            raise IppError(1007, f"theta {theta:g}; expected 0 to 180 degrees")
        self._values[name] = (x, y, z, theta, psi % 360.0, phi % 360.0)

    def point(self, xyz_mm: tuple[float, ...]) -> Floats:
        """Ball centre [mm] (3,) in the selected system, from the arm's.

        X0, Y0 and Z0 are the zero of the system before in this one (6.3.3.4).
        """
        place = np.array(xyz_mm)
        for name in self._steps():
            place = _rotation(*self._values[name][3:]) @ place + self._values[name][:3]
        return place

    def direction(self, ijk: tuple[float, ...]) -> Floats:
        """A direction (3,) in the selected system, from the arm's."""
        turned = np.array(ijk)
        for name in self._steps():
            turned = _rotation(*self._values[name][3:]) @ turned
        return turned

    def _steps(self) -> tuple[str, ...]:
        return CHAIN[1 : CHAIN.index(self.selected) + 1]


def _rotation(theta: float, psi: float, phi: float) -> Floats:
    """Matrix of appendix A.4.2: about z by psi, x by theta, z by phi [degrees]."""
    angles = np.radians([theta, psi, phi])
    (c1, c2, c3), (s1, s2, s3) = np.cos(angles), np.sin(angles)
    about_z = np.array([[c2, s2, 0], [-s2, c2, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, c1, s1], [0, -s1, c1]])
    about_new_z = np.array([[c3, s3, 0], [-s3, c3, 0], [0, 0, 1]])
    turn: Floats = about_new_z @ about_x @ about_z
    return turn
