"""Messages as lines of text, for terminals and pipes."""

from datetime import UTC, datetime

from traverse.protocol.messages import (
    Event,
    Health,
    Live,
    Message,
    Point,
    Reply,
    Scan,
    Status,
)
from traverse.protocol.printable import printable


def line(arm: str, message: Message) -> str:
    return printable(f"{arm}  {_content(message)}")


def _content(message: Message) -> str:
    match message:
        case Point():
            flags = "" if message.quality.ok else "  " + ",".join(message.quality.flags)
            summary = (
                f"retracts {message.retracts}" if message.retracts else _xyz(message)
            )
            text = f"{_time(message.time_ns)} point {message.seq:5d}  {summary}{flags}"
        case Scan():
            n = len(message.dtime_ns)
            numbers = f"points {message.seq} to {message.seq + n - 1}"
            ended = f", ended with {message.total}" if message.last else ""
            text = (
                f"{_time(message.time_ns)} scan {message.scan} "
                f"{numbers if n else 'no points'}, lost {message.lost}, "
                f"dropped {message.dropped}{ended}"
            )
        case Live():
            text = f"{_time(message.time_ns)} live         {_xyz(message)}"
        case Event():
            times = f" ({message.count} times)" if message.count > 1 else ""
            remedy = f"; {message.remedy}" if message.remedy else ""
            text = (
                f"{_time(message.last_ns)} {message.severity} {message.code} "
                f"[{message.source}]: {message.text}{times}{remedy}"
            )
        case Status():
            drivers = ", ".join(f"{d.id} {d.state}" for d in message.drivers)
            text = f"{_time(message.time_ns)} status {message.state}; {drivers}".rstrip(
                "; "
            )
            text += "".join(
                f"; {condition.name} of {condition.source} in doubt: {condition.cause}"
                for condition in message.conditions
                if not condition.established
            )
        case Health():
            rate = message.rates_hz.get("samples_received", 0.0)
            text = (
                f"{_time(message.time_ns)} health CPU {message.cpu_share:.1%} of a "
                f"core, {message.rss_bytes / 1e6:.0f} MB, {rate:.0f} samples/s, "
                f"broker {message.broker.state}"
            )
        case Reply():
            outcome = message.result if message.error is None else message.error.text
            text = f"reply to {message.request}: {outcome}"
        case _:
            text = str(message)
    return text


def _xyz(message: Point | Live) -> str:
    x, y, z = message.xyz_mm
    return f"{x:10.4f} {y:10.4f} {z:10.4f} mm"


def _time(time_ns: int) -> str:
    moment = datetime.fromtimestamp(time_ns // 1_000_000_000, UTC)
    return f"{moment:%H:%M:%S}.{time_ns // 1_000_000 % 1000:03d}"
