"""Inputs of a board and their debouncing."""

from traverse.simulator.scenario.signals import LatchedEdge


class InputLevels:
    """Levels as they are, and as they are known to have held.

    Attributes:
        levels: Bit i set where input i is active.
    """

    def __init__(self) -> None:
        self.levels = 0
        self._reported = 0
        self._watched: dict[int, tuple[float, LatchedEdge]] = {}

    def change(self, input_number: int, level: int) -> bool:
        """Take a new level; True where an edge begins that must be latched."""
        bit = 1 << input_number
        self.levels = self.levels & ~bit | bit * level
        if self._watched.pop(input_number, None) is not None:
            return False  # back at the old level before the new one had held
        return bool(self._reported & bit) != bool(level)

    def watch(self, edge: LatchedEdge, held_at_s: float) -> None:
        """Wait whether an edge that was latched holds until a time."""
        self._watched[edge.input_number] = (held_at_s, edge)

    def next_held_s(self) -> float:
        """When the next edge has held; infinity if none is watched."""
        times_s = (held_at_s for held_at_s, _ in self._watched.values())
        return min(times_s, default=float("inf"))

    def take_held(self, now_s: float) -> list[LatchedEdge]:
        """Give the edges that have held, in order of time."""
        held = [edge for at_s, edge in self._watched.values() if at_s <= now_s]
        for edge in held:
            del self._watched[edge.input_number]
            self._reported ^= 1 << edge.input_number
        return sorted(held, key=lambda edge: edge.time_s)
