"""Error frames of Linux SocketCAN: the controller's report on its bus.

A frame with `ERROR_FLAG` in its identifier is from the controller and not from the
bus; the other bits of the identifier are classes of errors, the data explain them
(linux/can/error.h).
"""

from dataclasses import dataclass

ERROR_FLAG = 0x2000_0000
_CONTROLLER, _BUS_OFF, _RESTARTED = 0x04, 0x40, 0x100
_OVERFLOW, _PASSIVE, _ACTIVE = 0x01 | 0x02, 0x10 | 0x20, 0x40


@dataclass(frozen=True, slots=True)
class BusCondition:
    """Contents of one error frame; several can be true at once.

    Attributes:
        bus_off: the controller has left the bus.
        restarted: it is back on it.
        passive: error passive: many errors lately.
        overflow: frames were lost in the controller.
    """

    bus_off: bool = False
    restarted: bool = False
    passive: bool = False
    active: bool = False
    overflow: bool = False


def decode_error(can_id: int, data: bytes | bytearray) -> BusCondition:
    """Read an error frame.

    The second of up to eight bytes is the controller's state.
    """
    state = data[1] if can_id & _CONTROLLER and len(data) > 1 else 0
    return BusCondition(
        bus_off=bool(can_id & _BUS_OFF),
        restarted=bool(can_id & _RESTARTED),
        passive=bool(state & _PASSIVE),
        active=bool(state & _ACTIVE),
        overflow=bool(state & _OVERFLOW),
    )
