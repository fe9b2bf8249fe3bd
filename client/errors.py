"""What a client of an arm may have to hear."""

from dataclasses import dataclass

from traverse.protocol.messages import ReplyError


class ClientError(Exception):
    """Something went wrong between this program and an arm."""


class BrokerUnreachableError(ClientError):
    """No connection to the broker came about in the time allowed."""


class NoAnswerError(ClientError):
    """A command was not answered in the time allowed; it may have been carried out."""


class CommandRefused(ClientError):  # noqa: N818 - the answer of a sound arm
    """The arm did not carry out a command, and says why.

    Attributes:
        code: for programs, in dotted words: "device.lost".
        text: for people.
        remedy: what to do about it.
    """

    def __init__(self, code: str, text: str, remedy: str) -> None:
        super().__init__(f"{text}; {remedy} ({code})" if remedy else f"{text} ({code})")
        self.code = code
        self.text = text
        self.remedy = remedy

    @classmethod
    def of(cls, error: ReplyError) -> "CommandRefused":
        """What an answer says."""
        return cls(error.code, error.text, error.remedy)


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
