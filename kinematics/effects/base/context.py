"""Values of the arm file that effects are built with."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm, Effect

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

Span = tuple[datetime, datetime]


@dataclass(frozen=True, slots=True)
class EffectContext:
    """Values of the arm that effects are built with.

    Attributes:
        joint_names: from the base outwards.
        reference_temperature_c: at which the geometry holds.
        campaign_utc: start and end of the campaign that drifts were found in, or
            None.
    """

    joint_names: tuple[str, ...]
    reference_temperature_c: float
    campaign_utc: Span | None = None

    @property
    def n_joints(self) -> int:
        return len(self.joint_names)

    def joint(self, effect: "Effect") -> int:
        if effect.joint is None:
            raise ValueError(
                f"{effect.kind} names no joint; add joint = one of "
                f"{', '.join(self.joint_names)}"
            )
        if effect.joint not in self.joint_names:
            raise ValueError(
                f"{effect.kind} names joint {effect.joint!r}, which this arm does not "
                f"have; it has {', '.join(self.joint_names)}"
            )
        return self.joint_names.index(effect.joint)

    def joints(self, effect: "Effect") -> slice:
        if effect.joint is None:
            return slice(0, self.n_joints)
        joint = self.joint(effect)
        return slice(joint, joint + 1)

    def epoch_ns(self, effect: "Effect") -> int:
        """Return the origin of an effect's seconds, UTC since 1970."""
        if effect.epoch_utc is None:
            raise ValueError(
                f"{effect.kind} has no epoch_utc, so its seconds count from nowhere; "
                "add epoch_utc with a time zone"
            )
        return utc_ns(effect.epoch_utc)

    def span_ns(self, effect: "Effect") -> tuple[int, int]:
        """Return the validity of a drift, UTC since 1970.

        Without a known campaign it is the epoch alone, where a drift is zero.
        """
        if self.campaign_utc is None:
            epoch = self.epoch_ns(effect)
            return epoch, epoch
        start, end = self.campaign_utc
        return utc_ns(start), utc_ns(end)


def utc_ns(moment: datetime) -> int:
    """Convert a moment with a time zone to nanoseconds since 1970, exactly."""
    elapsed = moment - _EPOCH
    return (
        (elapsed.days * 86_400 + elapsed.seconds) * 10**6 + elapsed.microseconds
    ) * 1000


def context_from_arm(arm: "Arm", campaign_utc: Span | None = None) -> EffectContext:
    """Take an arm file's values for building effects."""
    return EffectContext(
        joint_names=tuple(joint.name for joint in arm.joints),
        reference_temperature_c=arm.reference.temperature_c,
        campaign_utc=campaign_utc,
    )
