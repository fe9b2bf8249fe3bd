"""What a client has met with, in numbers."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Counters:
    """What a client has met with since it was opened.

    Attributes:
        connections: how often a connection to the broker came about.
        points: points that came, whatever became of them.
        duplicates: points that came once more and were left out.
        asked_again: points that the arm was asked to send again.
        lost: points that could not be had any more.
        undecodable: messages that could not be understood.
    """

    connections: int
    points: int
    duplicates: int
    asked_again: int
    lost: int
    undecodable: int
