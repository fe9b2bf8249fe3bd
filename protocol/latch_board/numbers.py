"""Numbers of docs/serial-protocol.md: types, results, status bits, alarms."""

MAJOR = 1
FORGET_EDGES = 1  # flag of HELLO

HELLO, CONFIGURE, START, STOP, LATCH, EDGE_ACK = 1, 2, 3, 4, 5, 6
EDGE = 0x84
REQUEST_NAMES = {1: "HELLO", 2: "CONFIGURE", 3: "START", 4: "STOP", 5: "LATCH"}
RESULTS = {
    0: "done",
    1: "request not known",
    2: "wrong length",
    3: "rate out of range",
    4: "protocol version not supported",
    5: "value out of range",
    6: "not possible before HELLO",
}
STATUS_ERROR, STATUS_WARNING, STATUS_LATE, STATUS_STALE = 1, 2, 4, 8
ALARMS = {
    1: "encoder signal weak",
    2: "encoder error, count not valid",
    3: "encoder turned faster than it can follow",
    4: "supply voltage out of range",
    5: "board temperature out of range",
    6: "frames dropped, the line is too slow",
    7: "edges lost, not acknowledged in time",
    8: "encoder does not answer",
}
WHOLE_BOARD = 0xFF  # channel of an alarm
NO_SENSOR = -32768
