"""When an encoder took the count that it sent.

It did so after the last bit of the request and before the first of the reply, which is
known better than the exchange lasted: bytes take their time on the wire. They do not
where a pseudo-terminal stands in for the line, which exchanges show that are quicker.
"""


class ExchangeTimer:
    """Finds the instants of the counts of one line.

    Args:
        byte_ns: duration of a byte on the wire.
    """

    def __init__(self, byte_ns: int) -> None:
        self._byte_ns = byte_ns
        self._is_paced = True

    def latch(
        self, sent_ns: int, received_ns: int, request_bytes: int, reply_bytes: int
    ) -> tuple[int, int]:
        """Return the instant of a count, and how far that may be off."""
        wire_ns = (request_bytes + reply_bytes) * self._byte_ns
        if received_ns - sent_ns < wire_ns:
            self._is_paced = False
        if self._is_paced:
            sent_ns += request_bytes * self._byte_ns
            received_ns -= reply_bytes * self._byte_ns
        half_ns = (received_ns - sent_ns) // 2
        return sent_ns + half_ns, max(half_ns, 1)
