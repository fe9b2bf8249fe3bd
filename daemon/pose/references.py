"""Which devices' positions are only assumed: after a loss of power, or by whole turns.

A device that has been without power may count from another place, unless its encoders
are absolute. An absolute encoder reports its place within a turn, not how many turns
its joint has made; that matters where the pose is not the same a turn later, and where
the joint's end stops do not exclude another turn. Until the operator confirms, every
measurement is flagged `turns_uncertain`.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.covariates import CovariateBuilder
from traverse.drivers.base.values import DeviceUp, Identity
from traverse.kinematics.effects.pose import corrected_pose
from traverse.protocol.messages import QualityFlag

CODE = "device.turns_uncertain"
SAME_MM = 1e-6  # rounding moves the ball by less, an effect that matters by more
POSTURES_RAD = (0.3, 1.1)  # from the base posture, times the joint's number
PLACE, TURN = "place", "turn"
CONFIRM = "confirm (`traverse confirm`, or on the operator's page)"


class ReferenceMemory:
    """What has to be known of references after a restart of the daemon.

    Args:
        confirmed: by device, the power-up (`Identity.boot`) that was last confirmed.
        is_lost: it was kept, and cannot be read.

    Attributes:
        confirmed, is_lost: as given.
    """

    def __init__(
        self, confirmed: Mapping[str, str] | None = None, *, is_lost: bool = False
    ) -> None:
        self.confirmed = dict(confirmed or {})
        self.is_lost = is_lost

    def add(self, boots: Mapping[str, str]) -> None:
        """These power-ups are confirmed."""
        self.confirmed |= boots


class ReferenceMonitor:
    """Knows which devices may count from another place, until the operator confirms.

    Args:
        section: of the configuration; its end stops limit how far joints turn.
        model: the arm.
        clock: the host's.
        events: where doubts are reported.
        memory: outlives the daemon.
    """

    def __init__(
        self,
        section: QualitySection,
        model: ArmModel,
        clock: HostClock,
        events: EventLog,
        memory: ReferenceMemory,
    ) -> None:
        self._clock = clock
        self._events = events
        self._memory = memory
        self._boots: dict[str, str] = {}
        self._doubts: dict[str, str] = {}
        self._model = model
        self._turning = turn_dependent_joints(section, model, clock)

    @property
    def bits(self) -> int:
        """The flags of every measurement now."""
        return int(QualityFlag.TURNS_UNCERTAIN) if self._doubts else 0

    @property
    def state(self) -> dict[str, object]:
        """What `resume` needs."""
        confirmed = dict(self._memory.confirmed)
        return {"doubts": dict(self._doubts), "confirmed": confirmed}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from the `state` of another time."""
        self._doubts = dict(state["doubts"])
        self._memory = ReferenceMemory(state["confirmed"])

    def use(self, section: QualitySection, model: ArmModel) -> None:
        """Follow another arm file or other end stops."""
        before = self._turning if model.has_same_encoders(self._model) else ()
        self._model = model
        self._turning = turn_dependent_joints(section, model, self._clock)
        for device in self._boots:
            joints = self._joints_of(device)
            if any(joint in self._turning and joint not in before for joint in joints):
                self._doubt(device, TURN)

    def on_up(self, up: DeviceUp) -> None:
        """A device has answered, perhaps after a loss of power."""
        device, boot = up.device, up.identity.boot
        joints = self._joints_of(device)
        if not joints:
            return
        is_first = device not in self._boots
        self._boots[device] = boot
        is_absolute = [self._is_absolute(joint, up.identity) for joint in joints]
        was_off, confirmed = up.restarted, self._memory.confirmed.get(device)
        if is_first:
            is_other = bool(boot and confirmed) and boot != confirmed
            is_unknown = not boot or confirmed is None
            was_off |= is_other or (is_unknown and False in is_absolute)
            was_off |= self._memory.is_lost
        if was_off and not all(is_absolute):
            self._doubt(device, PLACE)
            return
        if is_first and confirmed is None:
            self._remember([device])
        if (is_first or up.restarted) and any(j in self._turning for j in joints):
            self._doubt(device, TURN)

    def confirm(self) -> list[str]:
        """Accept the present positions as right; gives the devices that it concerns."""
        devices = list(self._doubts)
        self._doubts.clear()
        for device in devices:
            text = f"the positions of {device} have been confirmed"
            self._events.change(False, "error", CODE, text, source=device)
        self._remember(devices)
        return devices

    def _remember(self, devices: Iterable[str]) -> None:
        boots = {d: self._boots[d] for d in devices if self._boots.get(d)}
        if boots:
            self._memory.add(boots)

    def _doubt(self, device: str, kind: str) -> None:
        known = self._doubts.get(device)
        if known in (kind, PLACE):
            return
        if known is not None:  # the alarm has more details from now on
            self._events.change(False, "error", CODE, "more is in doubt", source=device)
        self._doubts[device] = kind
        names = self._model.effects.joint_names
        joints = self._joints_of(device)
        if kind == TURN:
            joints = [joint for joint in joints if joint in self._turning]
        named = ", ".join(names[joint] for joint in joints)
        if kind == PLACE:
            text = (
                f"{device} has been without power: {named} may count from another "
                "place, and every point may be wrong"
            )
            remedy = (
                "bring the arm to its reference, touch a point that you know, then "
                f"{CONFIRM}; for encoders that are absolute, write absolute = true in "
                "[joints.encoder] of the arm file"
            )
        else:
            text = f"the turn of {named} is assumed, and the position depends on it"
            remedy = (
                f"turn {named} to within half a turn of the base posture and restart, "
                f"or touch a point that you know and {CONFIRM}; for a joint that turns "
                "less, write its end stops in [[quality.end_stops]]"
            )
        self._events.change(True, "error", CODE, text, source=device, remedy=remedy)

    def _joints_of(self, device: str) -> list[int]:
        return [j for j, d in enumerate(self._model.joint_devices) if d == device]

    def _is_absolute(self, joint: int, identity: Identity) -> bool | None:
        encoder = self._model.arm.joints[joint].encoder
        told = None if encoder is None else encoder.absolute
        return identity.absolute if told is None else told


def turn_dependent_joints(
    section: QualitySection, model: ArmModel, clock: HostClock
) -> tuple[int, ...]:
    """The joints of which a whole turn more or less would move the probe, from 0.

    Joints whose end stops leave one turn only, that nearest to zero, are left out.
    """
    zeros_rad = model.geometry.zeros_rad
    n_joints = len(zeros_rad)
    stops = {stop.joint: stop for stop in section.end_stops}
    moved = np.zeros(n_joints, dtype=np.bool_)
    turns_rad = 2.0 * np.pi * np.vstack([np.zeros(n_joints), np.eye(n_joints)])
    for share in POSTURES_RAD:
        posture_rad = zeros_rad + share * np.arange(1, n_joints + 1)
        block, _ = CovariateBuilder(model, clock).block(
            np.full(n_joints + 1, clock.monotonic_ns()),
            posture_rad + turns_rad,
            model.reference_temperature_c,
            np.zeros(n_joints + 1, dtype=np.uint32),
        )
        xyz_mm, _, _ = corrected_pose(model.geometry, model.effects, block)
        moved |= np.linalg.norm(xyz_mm[1:] - xyz_mm[0], axis=1) > SAME_MM

    def has_one_turn(joint: int) -> bool:
        stop = stops.get(model.effects.joint_names[joint])
        return stop is not None and bool(
            stop.low_rad >= zeros_rad[joint] - np.pi
            and stop.high_rad <= zeros_rad[joint] + np.pi
        )

    return tuple(j for j in np.flatnonzero(moved).tolist() if not has_one_turn(j))
