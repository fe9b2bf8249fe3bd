"""Arrays of an arm and of a block of samples that the kernel reads."""

from collections.abc import Sequence
from typing import Protocol

from traverse.arrays import Floats, Integers


class ArmArrays(Protocol):
    """An arm in its base posture, as in `traverse.kinematics.model.geometry`."""

    def __hash__(self) -> int:
        """By identity: the arrays do not change."""

    @property
    def origin_mm(self) -> Floats:
        """(3,)."""

    @property
    def axes(self) -> Floats:
        """Unit vectors, (n_joints, 3)."""

    @property
    def links_mm(self) -> Floats:
        """(n_joints, 3)."""

    @property
    def zeros_rad(self) -> Floats:
        """Readings in the base posture, (n_joints,)."""

    @property
    def probe_vector_mm(self) -> Floats:
        """From the end of the last link to the ball's centre, (3,)."""

    @property
    def probe_direction(self) -> Floats:
        """Unit vector towards the ball, (3,)."""

    @property
    def couplings(self) -> Sequence[tuple[int, int, float]]:
        """Joint, other, ratio: which the kernel does not handle."""


class BlockArrays(Protocol):
    """Samples, as `traverse.kinematics.effects.base.block` has them."""

    @property
    def angles_rad(self) -> Floats:
        """Readings, (n_samples, n_joints)."""

    @property
    def speeds_rad_s(self) -> Floats | None:
        """(n_samples, n_joints)."""

    @property
    def approaches(self) -> Floats | None:
        """(n_samples, n_joints)."""

    @property
    def temperature_c(self) -> Floats | None:
        """(n_samples,)."""

    @property
    def joint_temperatures_c(self) -> Floats | None:
        """(n_samples, n_joints)."""

    @property
    def utc_ns(self) -> Integers | None:
        """(n_samples,)."""

    @property
    def campaign_s(self) -> Floats | None:
        """(n_samples,)."""

    @property
    def force_n(self) -> Floats | None:
        """(n_samples,)."""
