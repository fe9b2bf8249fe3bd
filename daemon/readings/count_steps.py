"""By how much the counts of joints change at a time.

An encoder may resolve less than its counts: one of 12 bits whose value is passed on as
14, a board that rounds, a node that scales up. All of its changes are then multiples of
a step, and a place is known to a step, not to a count. Drivers state what the device's
words show; what they cannot know shows in the counts themselves.

Strategy: a joint that moves, or that only trembles, changes by single counts as often
as not. That forty changes of five sizes are all multiples of two is no chance; that all
have the same size may be one, of an arm that a script leads.
"""

from collections.abc import Mapping
from math import gcd
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.drivers.base.values import NOT_READ, CountSamples, DeviceUp

CODE = "device.coarse"
STEP_NS = 10_000_000  # between readings that are looked at
CHANGES, LEAST_SIZES = 40, 5
OTHER_CHANGES = 8  # that are no multiples: not some readings that were spoilt

REMEDY = (
    "nothing: the stated uncertainty holds it; where the encoder should resolve more, "
    "have its device pass on all digits or bits, or state its true counts_per_turn and "
    "identify the arm anew"
)


class CountStepMonitor:
    """Observes the steps of counts, which points' covariances need.

    Attributes:
        steps_counts: of the joints, (n_joints,); at least 1. Another array after a
            change.
    """

    def __init__(self, model: ArmModel, events: EventLog) -> None:
        self._events, self._model = events, model
        self._stated: dict[str, tuple[float, ...]] = {}  # by device
        self._seen: dict[int, int] = {}  # by joint: the step that its changes show
        self._named: dict[str, str] = {}  # coarse joints that were reported, by device
        self.use(model)

    def use(self, model: ArmModel) -> None:
        """Observe another arm; steps are kept where its encoders are the same."""
        if not model.has_same_encoders(self._model):
            self._seen.clear()
        self._model = model
        n_joints = len(model.joint_devices)
        self._changes = [list[int]() for _ in range(n_joints)]
        self._last: list[int | None] = [None] * n_joints
        self._looked_ns: dict[str, int] = {}
        self._update()

    @property
    def state(self) -> dict[str, Any]:
        return {
            "stated": {device: list(it) for device, it in self._stated.items()},
            "seen": [[joint, step] for joint, step in self._seen.items()],
            "changes": [list(changes) for changes in self._changes],
            "last": list(self._last),
            "looked_ns": dict(self._looked_ns),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        self._stated = {device: tuple(it) for device, it in state["stated"].items()}
        self._seen = {int(joint): int(step) for joint, step in state["seen"]}
        self._changes = [list(changes) for changes in state["changes"]]
        self._last = list(state["last"])
        self._looked_ns = dict(state["looked_ns"])
        self._update()

    def on_up(self, up: DeviceUp) -> None:
        """Begin anew with a device that has answered: it may be another."""
        self._stated[up.device] = up.identity.steps_counts
        for joint in self._joints_of(up.device):
            self._changes[joint].clear()
            self._last[joint] = None
            self._seen.pop(joint, None)
        self._update()

    def add(self, samples: CountSamples) -> None:
        """Observe the last reading of a block, if it is time."""
        device, time_ns = samples.device, int(samples.sample_time_ns[-1])
        if time_ns - self._looked_ns.get(device, 0) < STEP_NS:
            return
        self._looked_ns[device] = time_ns
        has_changed = False
        for joint in self._joints_of(device):
            channel = int(self._model.channels[joint])
            if samples.status[-1, channel] & NOT_READ:
                continue
            count, last = int(samples.counts[-1, channel]), self._last[joint]
            self._last[joint] = count
            if last is not None and count != last:
                self._changes[joint].append(abs(count - last))
                has_changed |= self._judge(joint)
        if has_changed:
            self._update()

    def _judge(self, joint: int) -> bool:
        """Learn the step of a joint from many changes; return whether it is another."""
        changes, step = self._changes[joint], self._seen.get(joint, 1)
        if len(changes) < CHANGES:
            return False
        if step > 1:
            if sum(change % step != 0 for change in changes) >= OTHER_CHANGES:
                del self._seen[joint]
        elif len(set(changes)) >= LEAST_SIZES and gcd(*changes) > 1:
            self._seen[joint] = gcd(*changes)
        changes.clear()
        return self._seen.get(joint, 1) != step

    def _update(self) -> None:
        """Compute the steps, and report joints that are coarse."""
        model, steps = self._model, np.ones(len(self._model.joint_devices))
        for joint, device in enumerate(model.joint_devices):
            stated, channel = self._stated.get(device, ()), int(model.channels[joint])
            if channel < len(stated):
                steps[joint] = max(1.0, stated[channel])
            steps[joint] = max(steps[joint], self._seen.get(joint, 1))
        self.steps_counts: Floats = steps
        for device in model.devices:
            named = ", ".join(
                self._described(j) for j in self._joints_of(device) if steps[j] > 1.0
            )
            before, self._named[device] = self._named.get(device, ""), named
            if before and before != named:
                text = f"{device} resolves its counts, or others do not"
                self._events.change(False, "warning", CODE, text, source=device)
            if named:
                text = f"{device} resolves less than its counts: {named}"
                self._events.change(
                    True, "warning", CODE, text, source=device, remedy=REMEDY
                )

    def _described(self, joint: int) -> str:
        model, step = self._model, self.steps_counts[joint]
        per_turn = int(model.encoders.counts_per_turn[joint])
        return (
            f"{model.effects.joint_names[joint]} changes by {step:.4g} of {per_turn} "
            f"counts a turn, {per_turn / step:.0f} places"
        )

    def _joints_of(self, device: str) -> list[int]:
        return [j for j, of in enumerate(self._model.joint_devices) if of == device]
