"""Bytes of a latching board to messages, in whole reads."""

from collections import Counter

from traverse.protocol.latch_board.bodies import PARSERS, sample_block
from traverse.protocol.latch_board.framing import FrameSplitter
from traverse.protocol.latch_board.messages import Message


class Decoder:
    """Bytes of a board in, messages out; faults are counted, never raised."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter()

    @property
    def faults(self) -> Counter[str]:
        """Frames dropped so far, by reason."""
        return self._splitter.faults

    @property
    def accepted(self) -> int:
        """Frames that were valid as frames, unknown types included."""
        return self._splitter.accepted

    @property
    def pending(self) -> int:
        """Bytes kept for the next call."""
        return self._splitter.pending

    def feed(self, data: bytes) -> list[Message]:
        """Messages completed by ``data``, in the order of the bytes."""
        messages: list[Message] = []
        run: list[bytes] = []
        for body in self._splitter.feed(data):
            if body[0] == 0x83 and len(body) >= 17 and body[1] == 0:
                if run and (len(body) != len(run[0]) or body[2] != run[0][2]):
                    messages.append(sample_block(run))
                    run = []
                if (len(body) - 12) % 5:
                    self.faults["bad_length"] += 1
                else:
                    run.append(body)
                continue
            if run:
                messages.append(sample_block(run))
                run = []
            message = self._decode(body)
            if message is not None:
                messages.append(message)
        if run:
            messages.append(sample_block(run))
        return messages

    def _decode(self, body: bytes) -> Message | None:
        parse = PARSERS.get(body[0])
        if parse is None:
            self.faults["unknown_type"] += 1
            return None
        message = parse(body)
        if message is None:
            self.faults["bad_length"] += 1
        return message
