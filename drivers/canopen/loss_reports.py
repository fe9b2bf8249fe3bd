"""What was lost or is in doubt on a bus, told as faults and counted for `health`."""

from collections import Counter
from collections.abc import Callable, Sequence

from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.io.can_bus import CanBus

COUNTED = {
    "delivered": "samples_received",
    "complete": "samples_complete",
    "late": "answers_late",
    "strays": "answers_stray",
    "pauses": "sync_pauses",
}

Fault = Callable[[str, str, str, int], None]


class Losses:
    """Takes the counts of the cycles and of the bus, and sets them back.

    Args:
        bus: open.
        nodes: their numbers, by channel.
        cycles: of this connection.
        report_fault: tells what was survived: code, text, remedy, how often.
        counters: of the driver.
    """

    def __init__(
        self,
        bus: CanBus,
        nodes: Sequence[int],
        cycles: SyncCycleAssembler,
        report_fault: Fault,
        counters: Counter[str],
    ) -> None:
        self._bus, self._nodes, self._cycles = bus, nodes, cycles
        self._tell_fault, self._counters = report_fault, counters
        self._dropped = 0

    def tell(self) -> None:
        """Tell what has come together since the last time."""
        cycles = self._cycles
        for name, counter in COUNTED.items():
            self._counters[counter] += getattr(cycles, name)
            setattr(cycles, name, 0)
        lost, cycles.lost = cycles.lost, 0
        if lost:
            self._tell_fault(
                "samples_lost",
                f"{lost} samples lost: no node answered, or no SYNC was sent",
                "lower the rate; check the load of bus and computer",
                lost,
            )
        for channel, n in cycles.missing.items():
            self._counters[f"missing_node_{self._nodes[channel]}"] += n
        self._tell_by_node(
            cycles.missing,
            "readings_missing",
            "SYNCs without an answer",
            "check these encoders; lower the rate if it is all of them",
        )
        self._tell_by_node(
            cycles.doubtful,
            "answers_doubtful",
            "answers that may be of another SYNC, flagged late",
            "check these encoders and the load of the bus; lower the rate",
        )
        dropped, self._dropped = self._bus.dropped - self._dropped, self._bus.dropped
        if dropped > 0:
            self.report_overflow(dropped)

    def report_overflow(self, n: int) -> None:
        """Frames came and could not be kept."""
        self._tell_fault(
            "frames_overflowed",
            f"frames were lost on {self._bus.name} because nobody read them in time",
            "lower the rate; give the daemon more of the computer; on SocketCAN let it "
            "keep more: sysctl net.core.rmem_max=4194304",
            n,
        )

    def _tell_by_node(
        self, counts: Counter[int], code: str, what: str, remedy: str
    ) -> None:
        if not counts:
            return
        who = ", ".join(
            f"node {self._nodes[channel]}: {n}" for channel, n in sorted(counts.items())
        )
        self._tell_fault(code, f"{what}: {who}", remedy, counts.total())
        counts.clear()
