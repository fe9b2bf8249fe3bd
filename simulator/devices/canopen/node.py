"""One encoder of CiA 406: its objects, and its response to SYNC.

The `canopen` library's local node answers SDO and NMT and sends heartbeats; TPDO1 at a
SYNC or by its timer, presets, storing and resets are added here.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from canopen import LocalNode, ObjectDictionary, SdoAbortedError
from canopen.network import Network
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

SWITCH_ALL, SET_NODE, SET_BIT_RATE, ACTIVATE, STORE = 0x04, 0x11, 0x13, 0x15, 0x17
SELECT_VENDOR, SELECT_PRODUCT, SELECT_REVISION, SELECT_SERIAL = 0x40, 0x41, 0x42, 0x43
SELECTED, IDENTIFIED = 0x44, 0x4F
FAST_SCAN, INQUIRE_IDENTITY, INQUIRE_NODE = 0x51, 0x5A, 0x5E
KNOWN_BIT_RATES = (0, 1, 2, 3, 4, 6, 7, 8)
UNCONFIGURED = 0x80  # "bits to check" of a fast scan that begins
REFUSED = 1
WITHOUT_NUMBER = 0xFF  # only such nodes answer a fast scan


class LssSlave:
    """The part of a node that answers on 7E5.

    The identity is vendor, product, revision and serial number.

    Attributes:
        node: its number from the next reset on.
        bit_rate: code of the commanded bit rate.
        stored: number and bit rate stored last.
        configures: it is in configuration state.
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
            self._say(command, 0 if known else REFUSED)
        elif command == SET_BIT_RATE:
            known = data[1] == 0 and data[2] in KNOWN_BIT_RATES
            if known:
                self.bit_rate = data[2]
            self._say(command, 0 if known else REFUSED)
        elif command == STORE:
            self.stored = (self.node, self.bit_rate)
            self._say(command, 0)
        elif INQUIRE_IDENTITY <= command < INQUIRE_NODE:
            word = self._identity[command - INQUIRE_IDENTITY]
            self._say(command, *word.to_bytes(4, "little"))
        elif command == INQUIRE_NODE:
            self._say(command, self.node)

    def _select(self, number: int, word: int) -> None:
        """Match vendor, product, revision and serial number, one after the other."""
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
        """Answer if the bits from ``bit`` up match the requested word."""
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


OPERATIONAL, PRE_OPERATIONAL, STOPPED = 5, 127, 4
PDO_OFF = 0x8000_0000
SAVE, LOAD = b"save", b"load"
OUT_OF_RANGE = 0x0609_0030
TYPES = {1: datatypes.UNSIGNED8, 2: datatypes.UNSIGNED16, 4: datatypes.UNSIGNED32}
STORED = ((0x1017, 0), (0x6000, 0), (0x6001, 0), (0x6002, 0), (0x6200, 0), (0x6509, 0))


@dataclass(frozen=True, slots=True)
class EncoderData:
    """Properties of an encoder."""

    number: int
    serial: int
    counts_per_turn: int
    turns: int
    modulus: int
    heartbeat_ms: int

    @property
    def identity(self) -> tuple[int, int, int, int]:
        return (0x0000_0053, 0x0196_0001, 0x0001_0000, self.serial)


class CanOpenEncoder:
    """An encoder on a bus.

    Attributes:
        count: of its disc, below its modulus; set before a request.
        alarms: object 6503.
        warnings: object 6505.
    """

    def __init__(self, data: EncoderData, network: Network) -> None:
        self.data = data
        self.count = 0
        self.alarms = self.warnings = 0
        self._network = network
        self._stored: dict[tuple[int, int], bytes] = {}
        self._syncs = 0
        self._timer_due_s = float("inf")
        self.lss = LssSlave(
            data.identity, data.number, lambda d: network.send_message(0x7E4, d)
        )
        self.node: LocalNode | None = None

    def power_up(self) -> None:
        """Begin as delivered, with stored settings, and send boot-up."""
        self.power_down()
        node = self.node = LocalNode(self.data.number, _objects(self.data))
        for (index, sub), content in self._stored.items():
            node.data_store.setdefault(index, {})[sub] = content
        node.add_read_callback(self._read)  # type: ignore[no-untyped-call]  # the library's
        node.add_write_callback(self._write)  # type: ignore[no-untyped-call]  # the library's
        self._network[self.data.number] = node
        self._timer_due_s = float("inf")
        node.nmt.state = "INITIALISING"  # the library sends the boot-up
        node.nmt.state = "PRE-OPERATIONAL"

    def power_down(self) -> None:
        if self.node is not None:
            self.node.nmt.stop_heartbeat()  # type: ignore[no-untyped-call]  # the library's
            del self._network[self.data.number]
            self.node = None

    @property
    def state(self) -> str:
        return "" if self.node is None else str(self.node.nmt.state)

    def obey(self) -> None:
        if self.state == "INITIALISING":
            self.power_up()

    def takes_questions(self) -> bool:
        return self.state in {"OPERATIONAL", "PRE-OPERATIONAL"}

    def sync(self) -> bytes | None:
        """Return the frame for a SYNC, if it answers this one."""
        kind = self._number(0x1800, 2)
        if not self._sends() or not 1 <= kind <= 240:
            return None
        self._syncs += 1
        return self.pdo() if self._syncs % kind == 0 else None

    def timer_due_s(self, now_s: float) -> float:
        """Return when its timer sends next; infinity for never."""
        period_s = 1e-3 * (self._number(0x1800, 5) or self._number(0x6200, 0))
        if not (self._sends() and self._number(0x1800, 2) >= 254 and period_s):
            self._timer_due_s = float("inf")
        elif self._timer_due_s == float("inf"):
            self._timer_due_s = now_s + period_s
        return self._timer_due_s

    def timer_pdo(self) -> bytes:
        self._timer_due_s += 1e-3 * (self._number(0x1800, 5) or self._number(0x6200, 0))
        return self.pdo()

    def pdo(self) -> bytes:
        content = b""
        if self.node is not None:
            for entry in range(1, self._number(0x1A00, 0) + 1):
                mapped = self._number(0x1A00, entry)
                n_bytes = (mapped & 0xFF) // 8
                data = self.node.get_data(mapped >> 16, mapped >> 8 & 0xFF)
                content += data[:n_bytes].ljust(n_bytes, b"\0")
        return content[:8]

    def position(self) -> int:
        """Return object 6004: reversed, scaled and preset as commanded."""
        parameters, modulus = self._number(0x6000, 0), self.data.modulus
        count = -self.count % modulus if parameters & 1 else self.count
        if parameters & 4:
            units, modulus = self._number(0x6001, 0), self._number(0x6002, 0)
            count = count * units // self.data.counts_per_turn
        return (count + self._number(0x6509, 0)) % max(1, modulus)

    def _sends(self) -> bool:
        if self.state != "OPERATIONAL":
            return False
        return not self._number(0x1800, 1) & PDO_OFF

    def _number(self, index: int, sub: int) -> int:
        if self.node is None:
            return 0
        return int.from_bytes(self.node.get_data(index, sub), "little")

    def _read(self, index: int, subindex: int, od: ODVariable) -> int | None:
        del subindex, od
        if index == 0x6004:
            return self.position()
        return {0x6503: self.alarms, 0x6505: self.warnings}.get(index)

    def _write(self, index: int, subindex: int, od: ODVariable, data: bytes) -> None:
        del od
        node = self.node
        if node is None:
            return
        if index == 0x6003:
            (preset,) = struct.unpack("<I", data)
            old = self._number(0x6509, 0)
            modulus = self._number(0x6002, 0)
            offset = (preset - self.position() + old) % max(1, modulus)
            node.data_store.setdefault(0x6509, {})[0] = struct.pack("<I", offset)
        elif index == 0x1010:
            if bytes(data) != SAVE:
                raise SdoAbortedError(OUT_OF_RANGE)
            self._stored = {key: node.get_data(*key) for key in STORED}
        elif index == 0x1011:
            if bytes(data) != LOAD:
                raise SdoAbortedError(OUT_OF_RANGE)
            self._stored = {}
        del subindex


def _objects(data: EncoderData) -> ObjectDictionary:
    identity = enumerate(data.identity, 1)
    kind = 2 if data.turns > 1 else 1
    dictionary = ObjectDictionary()  # type: ignore[no-untyped-call]  # the library's
    for index, n_bytes, access, value in (
        (0x1000, 4, "ro", kind << 16 | 0x0196),
        (0x1001, 1, "ro", 0),
        (0x1017, 2, "rw", data.heartbeat_ms),
        (0x6000, 2, "rw", 0),
        (0x6001, 4, "rw", data.counts_per_turn),
        (0x6002, 4, "rw", min(data.modulus, 0xFFFF_FFFF)),
        (0x6003, 4, "rw", 0),
        (0x6004, 4, "ro", 0),
        (0x6200, 2, "rw", 0),
        (0x6500, 2, "ro", 0),
        (0x6501, 4, "ro", data.counts_per_turn),
        (0x6502, 2, "ro", data.turns & 0xFFFF),
        (0x6503, 2, "ro", 0),
        (0x6504, 2, "ro", 3),
        (0x6505, 2, "ro", 0),
        (0x6506, 2, "ro", 0x14),
        (0x6507, 4, "ro", 0x0100_0302),
        (0x6508, 4, "ro", 0xFFFF_FFFF),
        (0x6509, 4, "ro", 0),
        (0x650B, 4, "ro", data.serial),
    ):
        dictionary.add_object(_variable(index, 0, n_bytes, access, value))
    cob_id = 0x180 + data.number
    for index, entries in (
        *((index, ((0, 1, "ro", 1), (1, 4, "rw", 1))) for index in (0x1010, 0x1011)),
        (0x1018, ((0, 1, "ro", 4), *((n, 4, "ro", w) for n, w in identity))),
        (0x1800, ((1, 4, "rw", cob_id), (2, 1, "rw", 254), (5, 2, "rw", 0))),
        (0x1801, ((1, 4, "rw", cob_id + 0x100), (2, 1, "rw", 1), (5, 2, "rw", 0))),
        (0x1A00, ((0, 1, "rw", 1), (1, 4, "rw", 0x6004_0020), (2, 4, "rw", 0))),
        (0x1A01, ((0, 1, "rw", 1), (1, 4, "rw", 0x6004_0020), (2, 4, "rw", 0))),
        (0x6030, ((0, 1, "ro", 1), (1, 2, "ro", 0))),
    ):
        record = ODRecord(f"{index:04X}", index)
        for sub, n_bytes, access, value in entries:
            record.add_member(_variable(index, sub, n_bytes, access, value))
        dictionary.add_object(record)
    name = ODVariable("1008", 0x1008)
    name.data_type, name.access_type = datatypes.VISIBLE_STRING, "ro"
    name.default = "simulated encoder"  # type: ignore[assignment]  # a string's is one
    dictionary.add_object(name)
    return dictionary


def _variable(
    index: int, sub: int, n_bytes: int, access: str, value: int
) -> ODVariable:
    variable = ODVariable(f"{index:04X}:{sub}", index, sub)
    variable.data_type = TYPES[n_bytes]
    variable.access_type = access
    variable.default = value
    return variable
