"""Objects of an encoder after CiA 301 and CiA 406, and the meaning of their bits.

From makers' manuals: alarm bits 0 and 1, warning bits 0 to 4, emergency codes up to
8140. General knowledge, to be checked against the manual of the encoder: warning bit 5,
and that bits 12 to 15 of alarms and warnings are the maker's own.
"""

DEVICE_TYPE = 0x1000
STORE = 0x1010
HEARTBEAT_MS = 0x1017
IDENTITY = 0x1018  # 1 vendor, 2 product, 3 revision, 4 serial number
TPDO = 0x1800  # of TPDO1; + 1 for each further one
TPDO_MAP = 0x1A00
OPERATING_PARAMETERS = 0x6000
UNITS_PER_TURN = 0x6001
MEASURING_RANGE = 0x6002
PRESET = 0x6003
POSITION_VALUE = 0x6004
TURN_RESOLUTION = 0x6501
TURNS = 0x6502
ALARMS = 0x6503
WARNINGS = 0x6505
PROFILE_VERSION = 0x6507
OFFSET = 0x6509  # that a preset adds

COUNTERCLOCKWISE = 0x0001  # bits of OPERATING_PARAMETERS
SCALING = 0x0004

ENCODER_PROFILE = 0x196  # 406, the low half of DEVICE_TYPE
KINDS = {1: "single-turn", 2: "multi-turn", 8: "linear"}  # its high half

PDO_OFF = 0x8000_0000
NO_REMOTE_REQUEST = 0x4000_0000  # bit of the same object
EVERY_SYNC = 1
MAP_OF_POSITION = 0x6004_0020  # index, sub-index, 32 bits
SAVE = b"save"

ALARM_BITS = {0: "position error", 1: "commissioning diagnostic"}
WARNING_BITS = {
    0: "too fast",
    1: "little light",
    2: "watchdog of its processor",
    3: "operating time used up",
    4: "battery low",
    5: "reference point not reached",
}

# Sorted from the special to the general: code, bits of it that count, text.
EMERGENCIES = (
    (0x5530, 0xFFFF, "memory of settings"),
    (0x8110, 0xFFFF, "frames lost: too many on the bus"),
    (0x8120, 0xFFFF, "error passive: the bus is disturbed"),
    (0x8130, 0xFFFF, "heartbeat or guarding missed"),
    (0x8140, 0xFFFF, "recovered from bus-off"),
    (0x1000, 0xFF00, "generic error"),
    (0x2000, 0xF000, "current"),
    (0x3000, 0xF000, "voltage"),
    (0x4000, 0xF000, "temperature"),
    (0x5000, 0xF000, "hardware"),
    (0x6000, 0xF000, "software"),
    (0x7000, 0xF000, "additional modules"),
    (0x8000, 0xF000, "communication"),
    (0x9000, 0xF000, "external error"),
    (0xFF00, 0xFF00, "of the maker's own"),
)

ABORTS = {
    0x0503_0000: "toggle bit not alternated",
    0x0504_0000: "timed out",
    0x0504_0001: "unknown command",
    0x0601_0000: "access not supported",
    0x0601_0001: "can only be written",
    0x0601_0002: "can only be read",
    0x0602_0000: "no such object",
    0x0604_0041: "cannot be mapped",
    0x0607_0010: "wrong length",
    0x0609_0011: "no such sub-index",
    0x0609_0030: "value out of range",
    0x060A_0023: "no data",
    0x0800_0022: "not in this state",
}


def alarm_text(bits: int) -> str:
    return _named(bits, ALARM_BITS)


def warning_text(bits: int) -> str:
    return _named(bits, WARNING_BITS)


def emergency_text(code: int) -> str:
    for known, mask, text in EMERGENCIES:
        if code & mask == known:
            return text
    return "an error of no known kind"


def _named(bits: int, names: dict[int, str]) -> str:
    known = [names.get(bit, f"bit {bit}") for bit in range(16) if bits >> bit & 1]
    return ", ".join(known) or "none"
