"""The table `[metrics]`: figures for Prometheus over HTTP."""

from pydantic import Field

from traverse.kinematics.arm_file.arm import StrictModel


class MetricsSection(StrictModel):
    """Where figures can be read; nowhere without a port."""

    port: int | None = Field(default=None, ge=1, le=65535)
    host: str = Field(default="127.0.0.1", min_length=1)
