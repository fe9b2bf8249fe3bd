import json
from pathlib import Path
from typing import Any, TypeVar

from traverse.protocol.encoding import decode
from traverse.protocol.messages import Event, Health, Live, Message, Point, Status
from traverse.protocol.messages.later_doubt import LaterDoubt

GOLDEN = Path(__file__).parents[2] / "protocol" / "golden"
M = TypeVar("M", bound=Message)


def golden(kind: type[M], name: str, **changes: Any) -> M:
    table = json.loads((GOLDEN / f"{name}.json").read_text("utf-8"))
    return decode(kind, json.dumps({**table, **changes}).encode())


def point(seq: int, **changes: Any) -> Point:
    return golden(Point, "point", seq=seq, id=f"p-{seq}", **changes)


def retraction(seq: int, of: int) -> Point:
    return point(seq, retracts=f"p-{of}")


def live(**changes: Any) -> Live:
    return golden(Live, "live", **changes)


def status(**changes: Any) -> Status:
    drivers = [
        {"id": "base", "driver": "x", "port": "y", "state": "ready", "identity": {}}
    ]
    usual = {"state": "ready", "drivers": drivers, "alarms": [], "conditions": []}
    return golden(Status, "status", **{**usual, **changes})


def doubt(from_ns: int = 0, until_ns: int = 0, points: str = "") -> LaterDoubt:
    ids = tuple(points.split())
    return LaterDoubt(points=ids, from_ns=from_ns, until_ns=until_ns, flags=("stale",))


def event(code: str, active: bool | None, **changes: Any) -> Event:
    return golden(Event, "event", code=code, active=active, **changes)


def health(**changes: Any) -> Health:
    return golden(Health, "health", **changes)
