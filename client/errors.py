"""Errors of a client."""

from dataclasses import dataclass


class ClientError(Exception):
    """Base class of failures between this program and an arm."""


class BrokerUnreachableError(ClientError):
    """There was no connection to the broker in time."""


class NoAnswerError(ClientError):
    """A command was not answered in time; it may have been executed."""


class CommandRefused(ClientError):  # noqa: N818 - the answer of a sound arm
    """The arm refused a command, with the reason.

    Attributes:
        code: for programs, in dotted words: "device.lost".
        remedy: what to do about it.
    """

    def __init__(self, code: str, text: str, remedy: str) -> None:
        super().__init__(f"{text}; {remedy} ({code})" if remedy else f"{text} ({code})")
        self.code = code
        self.text = text
        self.remedy = remedy


@dataclass(frozen=True, slots=True)
class Counters:
    """Counts of a client since it was opened.

    Attributes:
        connections: number of connections to the broker.
        duplicates: repeated points that were left out.
        resend_requested: points that were requested again.
        undecodable: messages that could not be decoded.
    """

    connections: int
    points: int
    duplicates: int
    resend_requested: int
    lost: int
    undecodable: int
