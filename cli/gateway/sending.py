"""Send an arm's points, or scans, by a gateway of lines until a signal."""

from typing import TYPE_CHECKING, Literal

from traverse.cli.gateway.running import report, until_signal
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.client.arm import Arm
    from traverse.client.gateways.lines import LineCounts, LineGateway

Kind = Literal["points", "scans"]


async def send(arm: "Arm", kind: Kind, sender: "LineGateway") -> None:
    """Send until SIGINT or SIGTERM; report the beginning, and the sums at the end."""
    outlet = sender.outlet
    async with outlet, arm:
        report(f"{kind} of {arm.name} to {outlet.name}: {outlet.promise}")
        work = sender.send_scans if kind == "scans" else sender.send_points
        # What is being sent when this ends is not done: the next one sends it.
        await until_signal(work(arm))
    report(_sums(sender.counts))


def _sums(counts: "LineCounts") -> str:
    return (
        f"{counted(counts.sent, 'line')} sent, "
        f"{counted(counts.held_back, 'point')} held back, "
        f"{counts.undone} taken back after they were sent, {counts.lost} lost"
    )
