"""The table `[outbox]` of the configuration."""

from pydantic import Field

from traverse.kinematics.arm_file.arm import StrictModel


class OutboxSection(StrictModel):
    """How long points are kept that the broker has."""

    keep_days: float = Field(default=90.0, gt=0.0, le=36_500.0)
    keep_mb: float = Field(default=1000.0, ge=1.0, le=1_000_000.0)
