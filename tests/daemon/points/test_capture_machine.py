"""No sequence of buttons, commands and failing disks loses or doubles a point.

The machine drives all that measures in the daemon, in a time of its own, with what the
driver of a latch board delivers. Every latch has counts that no other has, so that a
point itself contains the edge it belongs to. Points go to a real database when the
machine lets the disk work, some of them together; or the disk fails. The model is a
plain list of requests, evaluated at the end.
"""

import asyncio
from pathlib import Path

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import invariant, precondition, rule

from tests.daemon.points.capture_machine import MS, CaptureBench
from tests.daemon.points.expected_points import Asked
from traverse.daemon.points.input_monitor import BOUNCE_NS
from traverse.daemon.scans.plan import ScanPlan
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.queries import read_unsent
from traverse.daemon.store.records import StorageError, fail_all
from traverse.drivers.base.values import CountSamples, StreamStarted
from traverse.protocol.messages import Label

BUTTON, SWITCH, HOLDER, UNWIRED = range(4)

LABELS = [Label(), Label(artefact="plate"), Label(artefact="bar", feature="2")]


class CaptureMachine(CaptureBench):
    """Buttons pressed, edges delivered, commands sent, in any order."""

    # -- hands, time and the line ---------------------------------------------

    @rule(ms=st.sampled_from([1, 20, 300, 700, 1500]))
    def time_passes(self, ms):
        self.clock.now_ns += ms * MS

    @rule(number=st.integers(0, 3))
    def press_or_release(self, number):
        """Alternate; counts as low as fit joint 2 of the arm, each once."""
        active = number not in self.down
        self.counts += 1
        token, self.tokens = self.tokens, self.tokens + 1
        if active:
            self.down[number] = asked = self._pressed(number, token)
            if asked is not None:
                self.asked.append(asked)
        else:
            asked = self.down.pop(number)
            self.released_ns[number] = self.clock.now_ns
            if asked is not None:
                asked.held_ms = (self.clock.now_ns - asked.pressed_ns) / MS
        self.on_the_line.append(self.latch(number, active, token, self.counts))

    def _pressed(self, number, token) -> Asked | None:
        triggers = {BUTTON: "button", SWITCH: "switch", HOLDER: "button"}
        is_bounce = self.clock.now_ns - self.released_ns[number] < BOUNCE_NS
        if number == UNWIRED or (number == BUTTON and is_bounce):
            return None
        what = "press" if number == HOLDER else "point"
        now_ns = self.clock.now_ns
        return Asked(
            what, self.counts, triggers[number], pressed_ns=now_ns, token=token
        )

    @rule(n=st.integers(1, 5))
    def line_delivers(self, n):
        for delivery in self.on_the_line[:n]:
            self.take(delivery)
        del self.on_the_line[:n]

    @rule(n=st.integers(1, 4))
    def stream_goes_on(self, n):
        seq = np.arange(self.samples, self.samples + n)
        joint_counts = np.arange(self.sample_counts, self.sample_counts + n)
        self.samples, self.sample_counts = self.samples + n, self.sample_counts + n
        times_ns = self.clock.now_ns - (n - 1 - np.arange(n)) * MS
        counts = np.zeros((n, 3), np.uint32)
        counts[:, 2] = joint_counts
        samples = CountSamples(
            "base",
            self.stream,
            seq,
            times_ns // 1000,
            self.clock.now_ns,
            times_ns,
            np.zeros(n, np.uint8),
            counts,
            np.zeros((n, 3), np.uint8),
        )
        if (plan := self.scanner.plan) is not None:
            self.scan_counts[plan.id] += joint_counts[seq % plan.every == 0].tolist()
        self.take(samples)

    @rule()
    def daemon_looks_at_the_time(self):
        """It does so only after all that has arrived."""
        self.line_delivers(len(self.on_the_line))
        self.measurement.process_timeouts()

    # -- the disk ------------------------------------------------------------

    @rule(n=st.integers(1, 10))
    def disk_keeps(self, n):
        """Store some of the queue in one transaction; then notify all."""
        group, self.waiting = self.waiting[:n], self.waiting[n:]
        self.store.add([entry for _, entry in group])
        for keeping, _ in group:
            self.published.append(keeping.point)
            keeping.settle()

    @precondition(lambda self: self.waiting)
    @rule()
    def disk_fails(self):
        self.failures += 1
        failed = [keeping for keeping, _ in self.waiting]
        self.waiting.clear()
        fail_all(failed, StorageError("the disk is full", "make room"))

    @rule()
    def power_goes(self):
        """Points on disk now: every acknowledged point, in order."""
        copy = self.path.with_suffix(".copy")
        for end in ("", "-wal"):
            content = Path(f"{self.path}{end}").read_bytes()
            Path(f"{copy}{end}").write_bytes(content)
        Path(f"{copy}-shm").unlink(missing_ok=True)
        store = MessageDatabase(copy)
        stored = [
            (m.session, m.seq, m.id) for m in read_unsent(store.connection, 0, 10_000)
        ]
        store.close()
        assert stored == [(p.session, p.seq, p.id) for p in self.published]

    # -- commands: they arrive after all that was on the line before -----------

    def _in_order(self, asked, act) -> None:
        self.line_delivers(len(self.on_the_line))
        self.asked.append(asked)

        async def ask() -> None:
            self.answers.append(self.measurement.points.in_order(act))

        self.loop.run_until_complete(ask())

    @rule()
    def point_by_command(self):
        self.line_delivers(len(self.on_the_line))
        self.counts += 1
        self.asked.append(Asked("point", self.counts))

        async def ask() -> None:
            answer = asyncio.get_running_loop().create_future()
            self.answers.append(answer)
            self.measurement.latches[-self.counts] = answer, None
            self.take(self.latch(None, True, -self.counts, self.counts))

        self.loop.run_until_complete(ask())

    @rule()
    def undo(self):
        self._in_order(Asked("undo"), lambda: self.capture.undo("command"))

    @rule(label=st.sampled_from(LABELS))
    def label(self, label):
        def act() -> bool:
            self.capture.label = label
            return True

        self._in_order(Asked("label", value=label), act)

    @rule()
    def session(self):
        def act() -> bool:
            self.sessions.append(self.capture.begin_session().id)
            return True

        self._in_order(Asked("session"), act)

    @rule(number=st.integers(0, 2))
    def probe(self, number):
        def act() -> bool:
            self.measurement.set_model(self.models[number])
            return True

        self._in_order(Asked("probe", value=number), act)

    @precondition(lambda self: self.scanner.plan is None)
    @rule(every=st.integers(1, 2), held=st.booleans())
    def scan_starts(self, every, held):
        name = f"scan-{len(self.scan_counts)}"
        plan = ScanPlan(name, 100.0 / every, every, held=held)
        self.scan_counts[name] = []
        self.held_scans |= {name} if held else set()
        self.scanner.start(plan, self.measurement.model, self.capture.session.id)
        self.stream, self.samples = self.stream + 1, 0
        self.take(StreamStarted("base", self.stream, 100.0))

    @precondition(lambda self: self.scanner.plan is not None)
    @rule()
    def scan_stops(self):
        self.scanner.stop()

    # -- what must hold -------------------------------------------------------

    @invariant()
    def every_number_is_used_once_and_in_order(self):
        if not self.published:
            return
        by_session: dict[str, list[int]] = {}
        for point in self.published:
            by_session.setdefault(point.session, []).append(point.seq)
        for numbers in by_session.values():
            assert numbers == list(range(len(numbers)))
        assert len({point.id for point in self.published}) == len(self.published)

    @invariant()
    def edges_are_acknowledged_in_order(self):
        tokens = [token for token, _ in self.acknowledged]
        assert tokens == list(range(len(tokens)))

    def teardown(self):
        for number in list(self.down):
            self.press_or_release(number)
        self.clock.now_ns += 5_000 * MS
        self.daemon_looks_at_the_time()
        self.daemon_looks_at_the_time()
        self.disk_keeps(len(self.waiting))
        self.scanner.stop()
        try:
            # Each was answered; refusals are looked at, too.
            assert all(answer.exception() or True for answer in self.answers)
            self.compare_points()
            self.compare_scans()
            self.power_goes()
        finally:
            self.store.close()
            self.device.driver.close()
            self.loop.close()


TestCapture = CaptureMachine.TestCase
TestCapture.settings = settings(max_examples=40, stateful_step_count=40, deadline=None)
