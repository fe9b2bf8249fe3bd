"""All that is observed in readings, as one part of the measuring path."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import ArmReadings
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.readings.count_steps import CountStepMonitor
from traverse.daemon.readings.frozen_joints import FrozenJointMonitor
from traverse.daemon.readings.repeat_monitor import RepeatMonitor
from traverse.daemon.readings.stops import Series
from traverse.drivers.base.values import CountSamples, DeviceUp, RepeatedCount


class ReadingMonitors:
    """Feeds the conditions on readings, and knows the steps of counts.

    Attributes:
        count_steps: for the covariances of poses.
    """

    def __init__(
        self,
        model: ArmModel,
        conditions: ConditionMonitor,
        published: PublishedNumbers,
        events: EventLog,
    ) -> None:
        self._model, self._conditions = model, conditions
        self._frozen_joints = FrozenJointMonitor(conditions, published)
        self._repeats = RepeatMonitor(conditions, published)
        self.count_steps = CountStepMonitor(model, events)

    @property
    def state(self) -> dict[str, Any]:
        """Their states by names that snapshots have."""
        return {
            "frozen_joints": self._frozen_joints.state,
            "repeats": self._repeats.state,
            "count_steps": self.count_steps.state,
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from a snapshot; older ones lack some of the states."""
        self._frozen_joints.resume(state["frozen_joints"])
        if "repeats" in state:
            self._repeats.resume(state["repeats"])
        if "count_steps" in state:
            self.count_steps.resume(state["count_steps"])

    def use_model(self, model: ArmModel) -> None:
        """Observe another arm; doubts end where its encoders are others."""
        if not model.has_same_encoders(self._model):
            self._repeats.begin_all()
        self._model = model
        self.count_steps.use(model)

    def establish(self) -> None:
        """Establish the conditions that nothing is known against."""
        if not self._frozen_joints.counts:
            self._conditions.establish("channels")
        for device in self._model.devices:
            if not self._repeats.is_in_doubt(device):
                self._conditions.establish("single_readings", device)

    def on_up(self, up: DeviceUp) -> None:
        """Begin anew with a device that has answered: it may be another."""
        self._repeats.begin(up.device)
        self.count_steps.on_up(up)

    def add_samples(
        self, samples: CountSamples, moduli_counts: Sequence[int]
    ) -> list[RepeatedCount]:
        """Check the readings of a device, whose counts wrap there; return repeats."""
        self.count_steps.add(samples)
        return self._repeats.add(self._model, samples, moduli_counts)

    def add_readings(
        self,
        readings: ArmReadings,
        series_between: Callable[[int, int], Sequence[Series]],
    ) -> None:
        """Check the readings of all joints, see `FrozenJointMonitor.add`."""
        self._frozen_joints.add(self._model, readings, series_between)

    def take_repeat(self, repeat: RepeatedCount) -> None:
        """Take a repeat that a driver has found in lines that are no samples."""
        self._repeats.take(self._model, [repeat])
