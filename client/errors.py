"""What a client of an arm may have to hear."""

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
