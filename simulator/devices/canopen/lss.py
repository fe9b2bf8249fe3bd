"""Layer setting services of a node (CiA 305): its number and bit rate over the bus."""

from collections.abc import Callable

REQUEST, ANSWER = 0x7E5, 0x7E4
SWITCH_ALL, SET_NODE, SET_BIT_RATE, ACTIVATE, STORE = 0x04, 0x11, 0x13, 0x15, 0x17
SELECT_VENDOR, SELECT_PRODUCT, SELECT_REVISION, SELECT_SERIAL = 0x40, 0x41, 0x42, 0x43
SELECTED, IDENTIFIED = 0x44, 0x4F
FAST_SCAN, INQUIRE_IDENTITY, INQUIRE_NODE = 0x51, 0x5A, 0x5E
KNOWN_BIT_RATES = (0, 1, 2, 3, 4, 6, 7, 8)
UNCONFIGURED = 0x80  # "bits to check" of a fast scan that begins
OUT_OF_RANGE = 1
WITHOUT_NUMBER = 0xFF  # only such nodes answer a fast scan


class LssSlave:
    """The part of a node that answers on 7E5.

    The identity is vendor, product, revision and serial number.

    Attributes:
        node: The number that it has from the next reset on.
        bit_rate: Code of the commanded bit rate.
        stored: What was stored last: number and bit rate.
        configures: It is in the state in which it accepts settings.
    """

    def __init__(
        self,
        identity: tuple[int, int, int, int],
        node: int,
        answer: Callable[[bytes], None],
    ) -> None:
        self._identity, self._answer = identity, answer
        self.node, self.bit_rate = node, 0
        self.stored: tuple[int, int] | None = None
        self.configures = False
        self._matched = 0  # of the four selecting words
        self._scanned = 0  # of the four words of a fast scan

    def take(self, data: bytes) -> None:
        """Obey a request of eight bytes."""
        if len(data) != 8:
            return
        command, word = data[0], int.from_bytes(data[1:5], "little")
        if command == SWITCH_ALL:
            self.configures = data[1] == 1
        elif SELECT_VENDOR <= command <= SELECT_SERIAL:
            self._select(command - SELECT_VENDOR, word)
        elif command == FAST_SCAN:
            self._scan(word, data[5], data[6], data[7])
        elif self.configures:
            self._configure(command, data)

    def _configure(self, command: int, data: bytes) -> None:
        if command == SET_NODE:
            known = 1 <= data[1] <= 127 or data[1] == WITHOUT_NUMBER
            if known:
                self.node = data[1]
            self._say(command, 0 if known else OUT_OF_RANGE)
        elif command == SET_BIT_RATE:
            known = data[1] == 0 and data[2] in KNOWN_BIT_RATES
            if known:
                self.bit_rate = data[2]
            self._say(command, 0 if known else OUT_OF_RANGE)
        elif command == STORE:
            self.stored = (self.node, self.bit_rate)
            self._say(command, 0)
        elif INQUIRE_IDENTITY <= command < INQUIRE_NODE:
            word = self._identity[command - INQUIRE_IDENTITY]
            self._say(command, *word.to_bytes(4, "little"))
        elif command == INQUIRE_NODE:
            self._say(command, self.node)

    def _select(self, number: int, word: int) -> None:
        """Vendor, product, revision and serial number, one after the other."""
        if number != self._matched:
            self._matched = 0
        if number == self._matched and word == self._identity[number]:
            self._matched += 1
        else:
            self._matched = 0
        if self._matched == len(self._identity):
            self._matched = 0
            self.configures = True
            self._say(SELECTED)

    def _scan(self, word: int, bit: int, sub: int, following: int) -> None:
        """Answer if the bits from ``bit`` up are those of the requested word."""
        if self.configures or self.node != WITHOUT_NUMBER:
            return
        if bit == UNCONFIGURED:
            self._scanned = 0
            self._say(IDENTIFIED)
        elif (
            bit < 32
            and sub == self._scanned < 4
            and word >> bit == self._identity[sub] >> bit
        ):
            self._scanned = following
            self._say(IDENTIFIED)
            # The last bit of the last word, and the scan returns to the first.
            self.configures = bit == 0 and sub == 3 and following == 0

    def _say(self, *content: int) -> None:
        self._answer(bytes(content).ljust(8, b"\0"))
