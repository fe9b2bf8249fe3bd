"""What has happened, as messages of a recording."""

from collections.abc import Iterator

from traverse.daemon.recorder.item_queue import Item
from traverse.drivers.base.delivery_maps import delivery_to_map
from traverse.protocol.messages import Event, Point, Scan
from traverse.recording.maps import map_to_bytes
from traverse.recording.run_writer import Entry
from traverse.recording.views import (
    cloud_to_bytes,
    log_to_bytes,
    point_to_bytes,
    pose_to_bytes,
)

STEPS = "steps"


class RecordingEncoder:
    """Makes the messages of items, in order.

    Args:
        utc_offset_ns: what to add to host monotonic time.
    """

    def __init__(self, utc_offset_ns: int) -> None:
        self.utc_offset_ns = utc_offset_ns

    def entries(self, item: Item) -> Iterator[Entry]:
        """The messages of one item."""
        if item.kind == "published":
            yield from self._published(item)
            return
        if item.kind == "related":
            self.utc_offset_ns = item.value
        if item.kind == "delivered":
            topic = f"device/{item.value.device}/{item.what}"
            table = {"at_ns": item.at_ns, **delivery_to_map(item.value)}
        else:
            topic = STEPS
            table = {"at_ns": item.at_ns, "is": item.kind}
            if item.what:
                table["what"] = item.what
            if item.value is not None:
                table["value"] = item.value
        yield Entry(topic, item.at_ns + self.utc_offset_ns, map_to_bytes(table))

    def _published(self, item: Item) -> Iterator[Entry]:
        message, log_ns = item.value, item.at_ns + self.utc_offset_ns
        match message:
            case Point():
                yield Entry("point", log_ns, point_to_bytes(message))
                if message.retracts is None:
                    yield Entry("pose", log_ns, pose_to_bytes(message))
            case Scan():
                yield Entry("cloud", log_ns, cloud_to_bytes(message))
            case Event():
                yield Entry("log", log_ns, log_to_bytes(message))
