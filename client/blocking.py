"""An arm for programs without asyncio: scripts and notebooks."""

import contextlib
from collections.abc import (
    AsyncIterator,
    Callable,
    Coroutine,
    Iterable,
    Iterator,
    Mapping,
)
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, TypedDict, TypeVar, Unpack

from traverse.client.arm import Arm
from traverse.client.counters import Counters
from traverse.client.loop_thread import Items, LoopThread, Source
from traverse.client.mqtt.address import BrokerAddress
from traverse.client.points.session_points import Lost
from traverse.client.results import HeldSession, Resent, ResentScan
from traverse.protocol.messages import Args, Event, Health, Live, Point, Scan, Status
from traverse.protocol.messages.scan import ScanMode

T = TypeVar("T")


class ArmOptions(TypedDict, total=False):
    """Options of `Arm`, which explains them."""

    since: Literal["now", "beginning"] | Mapping[str, int]
    place_file: Path | str | None
    patience_s: float
    answer_s: float
    max_waiting: int


class BlockingArm:
    """An arm behind a broker; use with `with`.

    A thread of its own runs the loop that an `Arm` lives on; every method does what
    that of `Arm` does, and waits for it. Iterators end when nothing has come for
    ``quiet_s``, or never.

    Args:
        name, broker, options: as of `Arm`.
    """

    def __init__(
        self,
        name: str,
        broker: str | BrokerAddress = "localhost",
        **options: Unpack[ArmOptions],
    ) -> None:
        self._arm = Arm(name, broker, **options)
        self._loop: LoopThread | None = None
        self._points: Source[Point | Lost] | None = None

    def __enter__(self) -> Self:
        loop = LoopThread()
        try:
            loop.do(self._arm.__aenter__())
        except BaseException:
            loop.close()
            raise
        self._loop = loop
        self._points = Source(loop, self._arm.points_and_losses())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        loop = self._running()
        self._loop = None
        try:
            loop.do(self._arm.__aexit__(kind, error, trace))
        finally:
            loop.close()

    @property
    def place(self) -> dict[str, int]:
        """Next numbers by session; give it as ``since`` to go on from here."""
        return self._arm.place

    @property
    def counters(self) -> Counters:
        """What was met with so far."""
        return self._arm.counters

    @property
    def is_connected(self) -> bool:
        """Whether there is a connection to the broker."""
        return self._arm.is_connected

    def points(self, quiet_s: float | None = None) -> Iterator[Point]:
        """Points and retractions in order, none twice."""
        for item in self.points_and_losses(quiet_s):
            if isinstance(item, Point):
                yield item

    def points_and_losses(self, quiet_s: float | None = None) -> Items[Point | Lost]:
        """As `points`, with a `Lost` in the place of what cannot be had any more."""
        self._running()
        if self._points is None:
            raise RuntimeError("the arm was never opened")
        return Items(self._points, quiet_s)

    def events(self, quiet_s: float | None = None) -> Items[Event]:
        """Events from now on."""
        return self._items(_in_loop(self._arm.events), quiet_s)

    def live(self, quiet_s: float | None = None) -> Items[Live]:
        """The latest pose, again and again."""
        return self._items(_in_loop(self._arm.live), quiet_s)

    def scans(self, quiet_s: float | None = None) -> Items[Scan]:
        """Blocks of all scans from now on, whoever started them."""
        return self._items(self._arm.scans(), quiet_s)

    @contextlib.contextmanager
    def scan(
        self,
        mode: ScanMode = "time",
        *,
        rate_hz: float | None = None,
        spacing_mm: float | None = None,
        normal: Iterable[float] | None = None,
        offset_mm: float = 0.0,
        held: bool = False,
        quiet_s: float | None = None,
    ) -> Iterator[Items[Scan]]:
        """A scan that runs while a `with` does; gives its blocks."""
        loop = self._running()
        blocks = self._arm.scan(
            mode,
            rate_hz=rate_hz,
            spacing_mm=spacing_mm,
            normal=normal,
            offset_mm=offset_mm,
            held=held,
        )
        loop.do(blocks.__aenter__())
        try:
            yield Items(Source(loop, blocks), quiet_s)
        finally:
            loop.do(blocks.__aexit__(None, None, None))

    def status(self) -> Status:
        """How the arm is; the latest that it told."""
        return self._do(self._arm.status())

    def health(self) -> Health:
        """The daemon's latest figures."""
        return self._do(self._arm.health())

    def capture(
        self, samples: int | None = None, dwell_s: float | None = None
    ) -> Point:
        """Take a point now; the arm has it on disk when this returns."""
        return self._do(self._arm.capture(samples, dwell_s))

    def undo(self, point_id: str | None = None) -> Point:
        """Take the last point back; gives the retraction."""
        return self._do(self._arm.undo(point_id))

    def label(self, artefact: str | None = None, feature: str | None = None) -> None:
        """Say what the next points are taken on; nothing ends it."""
        self._do(self._arm.label(artefact, feature))

    def probe(self, name: str) -> str:
        """Change the probe; gives the digest of the arm with it."""
        return self._do(self._arm.probe(name))

    def reload(self) -> str:
        """Have arm file and configuration read again; gives the arm's digest."""
        return self._do(self._arm.reload())

    def align(
        self,
        rotation: Iterable[Iterable[float]],
        translation_mm: Iterable[float],
        *,
        scale: float = 1.0,
        name: str | None = None,
    ) -> None:
        """Give points part coordinates: scale * rotation * arm + translation_mm."""
        self._do(self._arm.align(rotation, translation_mm, scale=scale, name=name))

    def clear_alignment(self) -> None:
        """Points have no part coordinates any more."""
        self._do(self._arm.clear_alignment())

    def new_session(self, note: str | None = None) -> str:
        """Number from 0 again; gives the new session."""
        return self._do(self._arm.new_session(note))

    def sessions(self) -> tuple[HeldSession, ...]:
        """Sessions that the arm's outbox holds, oldest first."""
        return self._do(self._arm.sessions())

    def resend(
        self, session: str, from_seq: int = 0, to_seq: int | None = None
    ) -> Resent:
        """Have points sent again, to everybody who follows the arm."""
        return self._do(self._arm.resend(session, from_seq, to_seq))

    def resend_scan(
        self, scan: str, from_seq: int = 0, to_seq: int | None = None
    ) -> ResentScan:
        """Have blocks of a scan sent again, to everybody who follows the scans."""
        return self._do(self._arm.resend_scan(scan, from_seq, to_seq))

    def result(self, args: Args) -> Mapping[str, Any]:
        """Have any command carried out; gives what came of it."""
        return self._do(self._arm.result(args))

    def _items(
        self, opening: Coroutine[Any, Any, AsyncIterator[T]], quiet_s: float | None
    ) -> Items[T]:
        loop = self._running()
        return Items(Source(loop, loop.do(opening)), quiet_s)

    def _do(self, work: Coroutine[Any, Any, T]) -> T:
        try:
            loop = self._running()
        except RuntimeError:
            work.close()
            raise
        return loop.do(work)

    def _running(self) -> LoopThread:
        if self._loop is None:
            raise RuntimeError("the arm is not open; use it with `with`")
        return self._loop


async def _in_loop(make: Callable[[], T]) -> T:
    """Made where it will live."""
    return make()
