"""The `[recording]` table: the flight recorder and recordings with a name."""

from pydantic import Field

from traverse.kinematics.arm_file.arm import StrictModel


class RecordingSection(StrictModel):
    """What is recorded, how much of it is kept, and how safely."""

    flight: bool = True
    flight_s: float = Field(default=60.0, ge=20.0, le=3600.0)
    flight_mb: int = Field(default=64, ge=4, le=100_000)
    kept: int = Field(default=10, ge=1, le=1000)
    flush_s: float = Field(default=1.0, ge=0.1, le=10.0)
    sync: bool = False
    min_free_mb: int = Field(default=500, ge=10, le=1_000_000)
    max_mb: int = Field(default=20_000, ge=10, le=1_000_000)
