"""From a latch to a captured point: which trigger, which number, which flags."""

import uuid
from collections.abc import Callable, Mapping

from daemon.clock import HostClock
from daemon.model import ArmModel
from daemon.poses import LatchedPose
from protocol.messages import Label, Point, Quality
from protocol.messages.point import Covariance, Trigger


class Session:
    """The numbering that points belong to: one per start of the daemon."""

    def __init__(self) -> None:
        self.id = uuid.uuid4().hex
        self.next_seq = 0


class Capture:
    """Makes points; a refused one uses up no number.

    Args:
        clock: the host's.
        offer: hands a point to the outgoing queue; False if it has no room.
    """

    def __init__(self, clock: HostClock, offer: Callable[[Point], bool]) -> None:
        self._clock = clock
        self._offer = offer
        self.session = Session()
        self.captured = 0
        self.refused = 0

    def take(
        self,
        model: ArmModel,
        pose: LatchedPose,
        trigger: Trigger,
        temperature_c: float | None,
        covariance_mm2: Covariance | None = None,
    ) -> Point | None:
        """Capture the point at ``pose``; None if it had to be refused."""
        point = Point(
            session=self.session.id,
            seq=self.session.next_seq,
            id=f"{self.session.id}-{self.session.next_seq}",
            retracts=None,
            arm=model.name,
            model=model.digest,
            trigger=trigger,
            time_ns=self._clock.to_utc_ns(pose.sample_time_ns),
            xyz_mm=tuple(pose.xyz_mm.tolist()),
            ijk=tuple(pose.ijk.tolist()),
            surface_mm=None,
            compensation="none",
            part_xyz_mm=None,
            covariance_mm2=covariance_mm2,
            angles_rad=tuple(pose.angles_rad.tolist()),
            counts=tuple(pose.counts.tolist()),
            temperature_c=temperature_c,
            probe_radius_mm=model.probe_radius_mm,
            samples=1,
            spread_mm=None,
            label=Label(),
            quality=Quality.from_bits(pose.quality),
        )
        if not self._offer(point):
            self.refused += 1
            return None
        self.session.next_seq += 1
        self.captured += 1
        return point


class Triggers:
    """Which edges capture: (device, input) to the kind of trigger."""

    def __init__(self, inputs: Mapping[tuple[str, int], Trigger]) -> None:
        self._inputs = dict(inputs)

    @property
    def devices(self) -> set[str]:
        """Ids of the devices that have such inputs."""
        return {device for device, _ in self._inputs}

    def trigger_of(self, device: str, number: int | None) -> Trigger | None:
        """The trigger wired to an input; None if the input means nothing."""
        return None if number is None else self._inputs.get((device, number))
