"""Specification of a dense scan: a simulated campaign of drags."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.campaigns.artefacts import Cone, Sphere
from traverse.simulator.campaigns.spec import CampaignFile, spec_problems
from traverse.strict_toml.problems import Problem
from traverse.strict_toml.reader import StrictModel


class ScanTable(StrictModel):
    """How the ball is dragged.

    Attributes:
        seconds: of one drag; an artefact is dragged over n_poses times.
        move_seconds: between drags, without contact.
        wave_s: typical period of the waves in which joints move.
        swing: amplitude of the waves over half a joint's range.
        latch_jitter_s: standard deviation of the time from latch to receipt.
    """

    rate_hz: float = Field(default=200.0, ge=10.0, le=10000.0)
    seconds: float = Field(default=10.0, gt=0.5, le=3600.0)
    move_seconds: float = Field(default=2.0, ge=1.0)
    wave_s: float = Field(default=4.0, gt=0.2)
    swing: float = Field(default=0.35, gt=0.0, le=1.0)
    latch_jitter_s: float = Field(default=0.0005, ge=0.0)


class DenseFile(CampaignFile):
    """A simulated campaign with a table `scan`."""

    scan: ScanTable


def dense_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    yield from spec_problems(raw)
    if "mix" in raw:
        yield Problem("mix", "a scan names its artefacts; give [[artefacts]] instead")


def dense_misfits(file: DenseFile, arm: Arm) -> Iterator[Problem]:
    """Yield reasons why a scan is impossible."""
    for number, artefact in enumerate(file.artefacts):
        if not isinstance(artefact, Cone | Sphere):
            message = f"'{artefact.kind}' cannot be scanned; expected cone or sphere"
            yield Problem(f"artefacts[{number}].kind", message)
    if file.noise.blunder_share > 0.0:
        yield Problem("noise.blunder_share", "a scan has no blunders; expected 0")
    if bare := [joint.name for joint in arm.joints if joint.encoder is None]:
        yield Problem("arm", f"no encoder of {', '.join(bare)}; a scan needs counts")
