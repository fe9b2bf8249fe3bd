"""Requests that wait for their turn among points, a type for each kind."""

import asyncio
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, ClassVar

from traverse.daemon.acquisition.device import Device
from traverse.daemon.config.schema import Action
from traverse.daemon.current_request import CURRENT_REQUEST
from traverse.daemon.points.buttons import Press
from traverse.daemon.points.observation import Observation
from traverse.drivers.base.values import LatchedCounts
from traverse.protocol.messages import Point
from traverse.protocol.messages.point import Trigger

CAPTURING: frozenset[Action] = frozenset(("point", "average"))


@dataclass(slots=True, eq=False)
class EdgeRequest:
    """An edge of a button or a probe; it is acknowledged to its device at the end.

    Attributes:
        received_ns: when the daemon got it.
        deadline_ns: until when it may wait for readings.
        trigger: trigger wired to the input, if any.
        press: press of a button; None for releases and probes.
        ends: the hold that ends with this release.
        observation: of the arm at its instant; None where it captures nothing.
    """

    device: Device
    latch: LatchedCounts
    trigger: Trigger | None
    deadline_ns: int
    _: KW_ONLY
    press: Press | None = None
    ends: Press | None = None
    observation: Observation | None = None

    @property
    def received_ns(self) -> int:
        return self.latch.received_ns

    @property
    def captures(self) -> bool:
        if self.press is not None and self.press.action is not None:
            return self.press.action in CAPTURING
        return self.observation is not None


@dataclass(slots=True, eq=False)
class _Answered:
    """A request of a command, which waits for its result.

    Attributes:
        requested_by: request identifier of the command, if any.
    """

    received_ns: int
    deadline_ns: int
    answer: asyncio.Future[Any]
    _: KW_ONLY
    requested_by: str | None = field(default_factory=CURRENT_REQUEST.get)

    def resolve(self, outcome: object) -> None:
        if self.answer.done():
            return
        if isinstance(outcome, Exception):
            self.answer.set_exception(outcome)
        else:
            self.answer.set_result(outcome)


@dataclass(slots=True, eq=False)
class PointRequest(_Answered):
    """A command that takes a point."""

    answer: asyncio.Future[Point]
    observation: Observation
    captures: ClassVar[bool] = True


@dataclass(slots=True, eq=False)
class OrderedAct(_Answered):
    """A command that takes effect between points."""

    act: Callable[[], object]
    captures: ClassVar[bool] = False


Request = EdgeRequest | PointRequest | OrderedAct


def observation_of(request: Request) -> Observation | None:
    return None if isinstance(request, OrderedAct) else request.observation
