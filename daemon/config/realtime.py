"""The table `[realtime]`: what the reader threads may claim of the computer."""

import os
from typing import Annotated

from pydantic import Field, field_validator

from traverse.kinematics.arm_file.arm import StrictModel

MAX_PRIORITY = 98  # 99 is the kernel's own threads'


class RealtimeSection(StrictModel):
    """What the system is asked for; what it refuses is told and does without."""

    priority: int = Field(default=0, ge=0, le=MAX_PRIORITY)
    lock_memory: bool = False
    cpus: Annotated[tuple[int, ...], Field(max_length=64)] = ()

    @field_validator("cpus")
    @classmethod
    def _are_there(cls, cpus: tuple[int, ...]) -> tuple[int, ...]:
        there = sorted(os.sched_getaffinity(0))
        if missing := [cpu for cpu in cpus if cpu not in there]:
            told = ", ".join(map(str, there))
            message = f"this computer lends the daemon the CPUs {told}, not {missing}"
            raise ValueError(message)
        return cpus
