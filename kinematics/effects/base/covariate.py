"""Covariates that effects need besides the readings."""

from dataclasses import dataclass
from enum import StrEnum


class Covariate(StrEnum):
    """A quantity that may accompany the readings; the value is the plain word."""

    TEMPERATURE = "temperature"
    SPEED = "speed"
    APPROACH = "direction of approach"
    UTC = "time in UTC"
    CAMPAIGN_TIME = "time since the campaign's start"
    FORCE = "contact force"


@dataclass(frozen=True, slots=True)
class Need:
    """One covariate that every sample must have.

    Attributes:
        joint: Of this joint, counted from 0; None: of the arm as a whole.
    """

    covariate: Covariate
    joint: int | None = None
