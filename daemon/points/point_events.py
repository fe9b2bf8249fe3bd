"""What is told of edges, refusals, labels and sessions."""

from traverse.daemon.acquisition.device import Device
from traverse.daemon.errors import CaptureRefusedError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.request_queue import Request
from traverse.daemon.points.session import Session
from traverse.daemon.pose.arm_model import ArmModel
from traverse.drivers.base.values import LatchedCounts
from traverse.kinematics.probing.compensation import DirectionError
from traverse.protocol.messages import Label, Point


class PointEventReporter:
    """Tells what becomes of requests.

    Args:
        events: where it is told.
    """

    def __init__(self, events: EventLog) -> None:
        self._events = events

    def refused(self, error: CaptureRefusedError) -> None:
        """No point was taken, or none taken back."""
        self._events.report(
            "error",
            "capture.refused",
            str(error),
            source="capture",
            remedy=error.remedy,
        )

    def without_direction(self, error: DirectionError) -> None:
        """A point has no surface, since it is not known where the material is."""
        self._events.report(
            "warning",
            "capture.no_direction",
            str(error),
            source="capture",
            remedy="take the point again so that the direction is told",
        )

    def undone(self, retraction: Point) -> None:
        """A button has taken a point back."""
        self._tell("capture.undone", f"{retraction.retracts} is taken back")

    def label(self, label: Label) -> None:
        """Points are taken on something else from now on."""
        words = [word for word in (label.artefact, label.feature) if word is not None]
        text = f"points are taken on {', '.join(words)}" if words else "no label"
        self._tell("capture.label", text)

    def probe(self, name: str, model: ArmModel) -> None:
        """Another probe measures from now on."""
        text = f"probe {name}, radius {model.probe_radius_mm:g} mm, model "
        self._tell("capture.probe", text + model.digest[:12])

    def alignment(self, text: str) -> None:
        """The alignment has been set or cleared."""
        self._tell("capture.alignment", text)

    def session(self, session: Session) -> None:
        """A new session has begun."""
        text = f"session {session.id} begins{': ' if session.note else ''}"
        self._tell("capture.session", text + session.note)

    def edge(self, request: Request, device: Device, latch: LatchedCounts) -> None:
        """An edge was dealt with: first what it was, then the gesture it made."""
        trigger, press = request.trigger, request.press
        if trigger is None:
            return
        source = f"{device.section.id}/{latch.input}"
        self._events.report(
            "info",
            f"{trigger}.{'pressed' if latch.active else 'released'}",
            f"{trigger} {'on' if latch.active else 'off'}",
            source=source,
            distinct=True,
        )
        if press is not None and press.gesture not in ("click", "part", None):
            text = f"{press.gesture}: {press.action}"
            code = f"{trigger}.{press.gesture}"
            self._events.report("info", code, text, source=source, distinct=True)

    def _tell(self, code: str, text: str) -> None:
        self._events.report("info", code, text, source="capture", distinct=True)
