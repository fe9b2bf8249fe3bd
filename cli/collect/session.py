"""The running collection: messages of the arm, keys of the operator, the picture."""

import asyncio
import contextlib
import os
import sys
import termios
import tty
from collections import deque
from collections.abc import AsyncIterator, Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import typer
from rich.console import Console, RenderableType
from rich.live import Live as LivePicture

from traverse.broker.address import BrokerAddress
from traverse.broker.errors import MqttError
from traverse.cli.collect.view import instruction, shown, summary
from traverse.cli.common.point_flags import FlaggedPoints, remedy_of
from traverse.cli.common.refusals import UNREACHABLE
from traverse.client.cancel_tasks import run_until_first
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import received, subscribe
from traverse.daemon.pose.joint_motion import JointMotionTracker
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.lab.collection import plan as plans
from traverse.lab.collection.collection import CollectedTouch, Collection, touch_of
from traverse.lab.collection.figures import implausible_mm, same_place
from traverse.lab.collection.plan import Target
from traverse.plurals import counted
from traverse.protocol.messages import Live, Point, Status
from traverse.protocol.messages.later_doubt import LaterDoubt, flagged_by
from traverse.strict_toml.reader import read_strict

APPROACH_BAND_RAD = 5e-4  # hands that rest tremble less
RETRY_S = 1.0
LINES_SHOWN = 6
ANSWERS = "y: yes, count it; b: yes, and the others were not; else touch again."


def collection_of(
    file: CampaignFile, folder: Path, arm: Arm, each: int = 1
) -> Collection:
    """Collect into a campaign's folder, by its plan or `each` touches of a feature."""
    path = folder / plans.PLAN
    plan = read_strict(path, plans.PlanFile) if path.is_file() else None
    if plan is None:
        targets = plans.targets_of(file, each)
    else:
        targets = plans.planned_targets(plan, file, str(path))
    return Collection(file, folder, [joint.name for joint in arm.joints], targets, plan)


def run_collection(
    collection: Collection,
    arm: str,
    broker: BrokerAddress,
    allowed: frozenset[str],
    *,
    quiet: bool,
) -> None:
    """Collect until the operator quits, or all is done and there is no terminal.

    With ``quiet`` standard output is left to a report. Ends the command where the
    broker could not be reached at the start.
    """
    with contextlib.redirect_stdout(sys.stderr) if quiet else contextlib.nullcontext():
        reached = asyncio.run(_collected(collection, arm, broker, allowed))
    if not reached:
        raise typer.Exit(UNREACHABLE)


async def _collected(
    collection: Collection, arm: str, broker: BrokerAddress, allowed: frozenset[str]
) -> bool:
    session = _Session(collection, allowed)
    with session.picture():
        await run_until_first(session.listen(arm, broker), session.operate())
    for line in (*summary(collection), *session.flagged.lines()):
        typer.echo(line)
    return session.reached


class _Session:
    def __init__(self, collection: Collection, allowed: frozenset[str]) -> None:
        self._collection = collection
        self.flagged = FlaggedPoints(allowed)
        self._lines: deque[str] = deque(maxlen=LINES_SHOWN)
        self._live: LivePicture | None = None
        self._trail = JointMotionTracker(
            np.full(len(collection.joint_names), APPROACH_BAND_RAD)
        )
        self._next_seq: dict[str, int] = {}
        self._ended = asyncio.Event()
        self._current: Target | None = None
        self._suspect: CollectedTouch | None = None
        self._doubts: Sequence[LaterDoubt] = ()
        self._question = ""  # about the suspect
        self._go_on()
        self.reached = False

    @contextlib.contextmanager
    def picture(self) -> Iterator[None]:
        if not sys.stdout.isatty():
            self._say(instruction(self._collection, self._current))
            yield
            return
        with LivePicture(
            self._shown(), console=Console(), auto_refresh=False, screen=False
        ) as self._live:
            yield
        self._live = None

    async def listen(self, arm: str, broker: BrokerAddress) -> None:
        """Receive the arm's points; reconnects after an outage of the broker."""
        while not self._ended.is_set():
            try:
                async with ConfiguredClient(broker) as client:
                    self.reached = True
                    await subscribe(client, arm, ("point", "live", "status"))
                    self._say(f"following {arm} on {broker}")
                    async for item in received(client):
                        if isinstance(item.message, Live):
                            self._follow(item.message)
                        elif isinstance(item.message, Point):
                            self._take(item.message)
                        elif isinstance(item.message, Status):
                            self._doubt(item.message.doubts)
                        else:
                            self._say(f"{item.kind}: {item.error}")
                        if self._ended.is_set():
                            return
            except (MqttError, OSError) as error:
                typer.echo(f"broker {broker}: {error}", err=True)
                if not self.reached:
                    return
                await asyncio.sleep(RETRY_S)

    async def operate(self) -> None:
        """Obey keys, or lines where standard input is no terminal."""
        async for key in _keys():
            match key:
                case "n":
                    self._step(1)
                case "p":
                    self._step(-1)
                case "u":
                    self._undo()
                case "y" | "b" if self._suspect is not None:
                    self._believe(self._suspect, without_others=key == "b")
                case "q":
                    self._ended.set()
                    return
                case _:
                    self._say(f"{key!r} is none of n, p, u, q")
        await self._ended.wait()  # no terminal: until all is done

    def _follow(self, live: Live) -> None:
        if len(live.angles_rad) == len(self._collection.joint_names):
            times_ns = np.array([live.time_ns], dtype=np.int64)
            self._trail.add(times_ns, np.array([live.angles_rad]), np.ones(1, np.bool_))

    def _take(self, point: Point) -> None:
        self._watch_numbers(point)
        point, number = flagged_by(self._doubts, point), f"point {point.seq}"
        if point.retracts is not None:
            if self._suspect is not None and self._suspect.id == point.retracts:
                self._undo()
            elif self._collection.retract(point.retracts):
                self._say(f"{number} takes one back")
                self._go_on()
            return
        if len(point.angles_rad) != len(self._collection.joint_names):
            self._say(
                f"{number} has {counted(len(point.angles_rad), 'joint')}: left out"
            )
            return
        target = self._current
        if point.label.artefact is not None:
            label = point.label
            target = self._collection.target(str(label.artefact), label.feature or "")
            if target is None:
                self._say(f"{number} is labelled {label.artefact}: not in the campaign")
                return
        if bad := self.flagged.leaves_out(point.quality.flags):
            self._say(
                f"{number} left out: flagged {', '.join(bad)}; {remedy_of(bad[0])}"
            )
            return
        if target is None:
            self._say(f"{number} left out: nothing is left to touch")
            return
        motion = self._trail.at_instant(point.time_ns, np.array(point.angles_rad))
        known = bool(motion.are_speeds_known[0])
        touch = touch_of(
            point,
            target,
            motion.approaches[0] if known else None,
            motion.speeds_rad_s[0] if known else None,
        )
        off_mm = implausible_mm(self._collection, touch, point.probe_radius_mm)
        if off_mm is None:
            self._count(touch)
            return
        self._suspect = touch
        self._question = (
            f"{number} is {off_mm:.1f} mm off the others on {target} and does not "
            f"count. Was it the right place? {ANSWERS}"
        )
        self._say(self._question)

    def _doubt(self, doubts: Sequence[LaterDoubt]) -> None:
        """Leave out points that are in doubt since they were taken."""
        self._doubts = doubts
        suspects = [] if self._suspect is None else [self._suspect]
        for touch in [*suspects, *self._collection.touches.values()]:
            meant = (d.flags for d in doubts if d.means(touch.id, touch.time_ns))
            flags = dict.fromkeys(chain.from_iterable(meant))
            if not (bad := self.flagged.leaves_out(flags)):
                continue
            if touch is self._suspect:
                self._suspect = None
            self._collection.retract(touch.id)
            self._say(
                f"point {touch.seq} is left out again: flagged {', '.join(bad)} since; "
                f"{remedy_of(bad[0])}"
            )
            self._go_on()

    def _believe(self, suspect: CollectedTouch, *, without_others: bool) -> None:
        """Count the suspect; with `without_others`, retract the others of its place."""
        if without_others:
            for twin in same_place(self._collection, suspect):
                self._collection.retract(twin.id)
            self._say("the others on it are left out")
        self._count(suspect)

    def _count(self, touch: CollectedTouch) -> None:
        self._suspect = None  # the operator has corrected it
        target = self._collection.target(touch.artefact, touch.feature)
        if target is not None and self._collection.take(touch):
            done = self._collection.count(target)
            self._say(f"point {touch.seq} on {target}: {done} of {target.wanted}")
            self._go_on()

    def _watch_numbers(self, point: Point) -> None:
        expected = self._next_seq.get(point.session)
        if expected is not None and point.seq > expected:
            self._say(
                f"points {expected} to {point.seq - 1} did not arrive: touch again, "
                "or request them again"
            )
        self._next_seq[point.session] = max(point.seq + 1, expected or 0)

    def _undo(self) -> None:
        if self._suspect is not None:
            self._say(f"point {self._suspect.seq} is left out")
            self._suspect = None
            return
        if not self._collection.touches:
            self._say("nothing to undo")
            return
        last = max(self._collection.touches.values(), key=lambda touch: touch.time_ns)
        self._collection.retract(last.id)
        self._current = self._collection.target(last.artefact, last.feature)
        self._say(f"point {last.seq} on {self._current} is left out again")

    def _step(self, by: int) -> None:
        targets = self._collection.targets
        if self._current is None:
            self._current = targets[0 if by > 0 else -1]
        else:
            self._current = targets[(targets.index(self._current) + by) % len(targets)]
        self._say(instruction(self._collection, self._current))

    def _go_on(self) -> None:
        """Go to the next unfinished target once this one is done."""
        now = self._current
        unfinished = self._collection.unfinished()
        if now is None or now not in unfinished:
            self._current = unfinished[0] if unfinished else None
            if self._current is not None and now is not None:
                self._say(instruction(self._collection, self._current))
        if not unfinished and not sys.stdin.isatty():
            self._ended.set()
        self._refresh()

    def _say(self, line: str) -> None:
        self._lines.append(line)
        if self._live is None and not sys.stdout.isatty():
            typer.echo(line)
        self._refresh()

    def _refresh(self) -> None:
        if self._live is not None:
            self._live.update(self._shown(), refresh=True)

    def _shown(self) -> RenderableType:
        question = self._question if self._suspect is not None else ""
        return shown(self._collection, self._current, self._lines, question)


async def _keys() -> AsyncIterator[str]:
    """Keys pressed at a terminal, or the first letters of lines."""
    loop, descriptor = asyncio.get_running_loop(), sys.stdin.fileno()
    at_terminal = sys.stdin.isatty()
    before = termios.tcgetattr(descriptor) if at_terminal else None
    ready = asyncio.Event()
    try:
        # Not as a pipe of asyncio's: that would make the terminal non-blocking, for
        # what is written to it too.
        loop.add_reader(descriptor, ready.set)
    except PermissionError:
        return  # a file, not a terminal
    if at_terminal:
        tty.setcbreak(descriptor)
    waiting = b""
    try:
        while True:
            await ready.wait()
            ready.clear()
            if not (data := os.read(descriptor, 1 if at_terminal else 4096)):
                return
            *lines, waiting = (waiting + data).split(b"\n")
            if at_terminal:
                lines, waiting = [data], b""
            for line in lines:
                if text := line.decode(errors="replace").strip():
                    yield text[0].lower()
    finally:
        loop.remove_reader(descriptor)
        if before is not None:
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
