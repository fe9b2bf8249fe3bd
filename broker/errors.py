"""Errors between a client and its broker."""


class MqttError(Exception):
    """There is no connection, it has ended, or the broker refuses a request."""


class RefusedError(MqttError):
    """The broker answered with a reason code that means refusal.

    Attributes:
        code: of MQTT 5, or the return code of MQTT 3.1.1 in a refused connection.
        text: of the broker, if it gave one.
    """

    def __init__(self, code: int, text: str = "") -> None:
        super().__init__(f"reason code {code:#04x}{text and f' ({text})'}")
        self.code = code
        self.text = text


class ConnectRefusedError(RefusedError):
    """The broker refuses the connection."""


class DisconnectedError(RefusedError):
    """The broker has ended the connection, with a reason."""


class ConnectionCutError(MqttError):
    """The connection ended without a reason."""

    def __init__(self) -> None:
        super().__init__(
            "the connection was cut; the broker has ended, or the network between"
        )


class ClosedBeforeAnswerError(MqttError):
    """The broker closed the connection before it had answered."""

    def __init__(self) -> None:
        super().__init__("it closes the connection without a word")


def end_of_connection(cause: Exception | None, *, is_answered: bool) -> MqttError:
    """Return the error for a connection that neither side ended with a reason."""
    error: MqttError = ConnectionCutError()
    if not is_answered:
        is_cut = cause is None or isinstance(cause, ConnectionError)
        error = ClosedBeforeAnswerError() if is_cut else MqttError(str(cause))
    error.__cause__ = cause
    return error
