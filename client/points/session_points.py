"""One session's points put in order: what came, what is held back, what is missing."""

from dataclasses import dataclass

from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True)
class Lost:
    """Points that cannot be had any more.

    Attributes:
        from_seq, to_seq: the first and the last of them; ``to_seq`` None: nobody knows
            how many there were, if any.
        reason: why, for people.
    """

    session: str
    from_seq: int
    to_seq: int | None
    reason: str


class Followed:
    """A session whose points are taken in the order of their numbers.

    Attributes:
        session: its name.
        begun_ns: when it began [UTC].
        next_seq: the number that is handed on next.
        known: the highest number that is known to exist; -1 before the first.
        has_ended: whether no number above `known` will come.
        needs_confirmation: whether the outbox has to be asked if it knows this session.
        cut: why nobody can tell what came after `known`; empty where one can.
        held: points that came before their turn, by number.
    """

    def __init__(self, session: str, begun_ns: int, next_seq: int = 0) -> None:
        self.session = session
        self.begun_ns = begun_ns
        self.next_seq = next_seq
        self.known = next_seq - 1
        self.has_ended = False
        self.needs_confirmation = False
        self.cut = ""
        self.held: dict[int, Point] = {}

    @property
    def is_complete(self) -> bool:
        """Whether it has ended and everything of it has been handed on."""
        return self.has_ended and self.next_seq > self.known

    def missing(self) -> tuple[int, int] | None:
        """The first gap that is known of: its first and last number."""
        end = min(self.held) - 1 if self.held else self.known
        return None if end < self.next_seq else (self.next_seq, end)

    def see(self, seq: int) -> None:
        """A point of this number exists."""
        self.known = max(self.known, seq)

    def run(self) -> list[Point]:
        """Points whose turn it is; they count as handed on."""
        found = []
        while (point := self.held.pop(self.next_seq, None)) is not None:
            found.append(point)
            self.next_seq += 1
        return found

    def give_up(self, to_seq: int, reason: str) -> list[Point | Lost]:
        """Go on after gaps that cannot be filled: all up to a number.

        Returns:
            What is handed on: the gaps, and the points that are here.
        """
        self.see(to_seq)
        found: list[Point | Lost] = [*self.run()]
        while self.next_seq <= to_seq:
            end = min([to_seq, *(seq - 1 for seq in self.held)])
            found.append(Lost(self.session, self.next_seq, end, reason))
            self.next_seq = end + 1
            found += self.run()
        return found
