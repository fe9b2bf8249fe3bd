"""Identity and set-up of one node.

Rests on CiA 301 and CiA 406 as in makers' manuals. General knowledge, to be checked
against the encoder's manual: the order in which a PDO is mapped anew, and that 6502
(number of turns) is 0 if 65536 does not fit into its 16 bits.
"""

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass

from traverse.drivers.base.values import DeviceRefusedError
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sdo import NodeRefusedError, NodeSdo
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen import objects

WIDEST = 1 << 32
MOST_TURNS = 1 << 16
SINGLE_TURN = 1
FURTHER_TPDOS = (1, 2, 3)
SETTINGS = (
    (objects.TPDO, 1),
    (objects.TPDO, 2),
    (objects.TPDO_MAP, 0),
    (objects.TPDO_MAP, 1),
    (objects.OPERATING_PARAMETERS, 0),
    (objects.UNITS_PER_TURN, 0),
    (objects.MEASURING_RANGE, 0),
    (objects.OFFSET, 0),
)
"""Objects, with sub-indices, that say what a position frame means."""

NodeSettings = Mapping[tuple[int, int], int | None]


@dataclass(frozen=True, slots=True)
class NodeFacts:
    """Properties that an encoder reports.

    Attributes:
        device_type: object 1000; its low half is the profile.
        identity: vendor, product, revision, serial number, or None.
        profile: object 6507, version of profile and software.
        modulus: where its count wraps to 0.
        parameters: object 6000.
        offset: object 6509, by which its presets move the position.
        alarms: object 6503, of `traverse.protocol.canopen.objects.ALARM_BITS`.
        warnings: object 6505.
    """

    node: int
    device_type: int
    identity: tuple[int | None, int | None, int | None, int | None]
    profile: int | None
    counts_per_turn: int
    modulus: int
    parameters: int
    offset: int
    alarms: int
    warnings: int
    position: int

    @property
    def kind(self) -> str:
        number = self.device_type >> 16
        return objects.KINDS.get(number, f"kind {number}")

    @property
    def name(self) -> str:
        vendor, product, _, serial = (
            "?" if number is None else f"{number:x}" for number in self.identity
        )
        return f"{self.node}:{vendor}-{product}-{serial}"

    def counting(self, code_sequence: str) -> str:
        """How it counts, and from which place: bits of object 6000, object 6509.

        A ``code_sequence`` that is set at each start says nothing of the node.
        """
        bits = objects.COUNTERCLOCKWISE * (code_sequence == "keep") | objects.SCALING
        return f"{self.parameters & bits:x}/{self.offset:x}"

    @property
    def serial(self) -> str:
        vendor, product, _, serial = self.identity
        return f"{vendor or 0:x}-{product or 0:x}-{serial:x}" if serial else ""


def read_facts(sdo: NodeSdo, node: int) -> NodeFacts:
    """Read the identity of a node; changes nothing.

    Raises:
        DeviceRefusedError: it is no encoder.
        NodeError: it does not answer, or lacks a mandatory object.
    """
    device_type = sdo.read_number(objects.DEVICE_TYPE)
    if device_type & 0xFFFF != objects.ENCODER_PROFILE:
        raise DeviceRefusedError(
            f"node {node} reports device profile {device_type & 0xFFFF}, "
            f"expected an encoder, profile {objects.ENCODER_PROFILE} (object 1000 is "
            f"{device_type:08X})",
            "take this node out of the configuration, or give the right number",
        )
    vendor, product, revision, serial = (
        sdo.find_number(objects.IDENTITY, sub) for sub in (1, 2, 3, 4)
    )
    parameters = sdo.find_number(objects.OPERATING_PARAMETERS) or 0
    per_turn, modulus = _resolution(sdo, device_type >> 16, parameters)
    return NodeFacts(
        node,
        device_type,
        (vendor, product, revision, serial),
        sdo.find_number(objects.PROFILE_VERSION),
        per_turn,
        modulus,
        parameters,
        sdo.find_number(objects.OFFSET) or 0,
        sdo.find_number(objects.ALARMS) or 0,
        sdo.find_number(objects.WARNINGS) or 0,
        sdo.read_number(objects.POSITION_VALUE),
    )


def set_up_node(
    sdo: NodeSdo, facts: NodeFacts, options: CanOpenOptions
) -> tuple[NodeSettings, bool]:
    """Make a node send its position at every SYNC; nothing is stored in it.

    Returns:
        What its frames mean from now on, and whether it had lost such settings: it was
        without power, or never set up.

    Raises:
        NodeError: it does not answer, or refuses.
        DeviceRefusedError: it does not do as it was set.
    """
    forgotten = sdo.find_number(objects.HEARTBEAT_MS) != options.heartbeat_ms
    if options.code_sequence != "keep":
        parameters = facts.parameters & ~objects.COUNTERCLOCKWISE
        parameters |= objects.COUNTERCLOCKWISE * (options.code_sequence == "ccw")
        if parameters != facts.parameters:
            sdo.write(objects.OPERATING_PARAMETERS, 0, parameters, 2)
    _map_position(sdo, facts.node)
    for further in FURTHER_TPDOS:
        used = sdo.find_number(objects.TPDO + further, 1)
        if used is not None and not used & objects.PDO_OFF:
            # One that cannot be switched off costs room on the bus and no more.
            with contextlib.suppress(NodeRefusedError):
                sdo.write(objects.TPDO + further, 1, used | objects.PDO_OFF, 4)
    sdo.write(objects.HEARTBEAT_MS, 0, options.heartbeat_ms, 2)
    settings = read_settings(sdo)
    _check_position(sdo.name, facts.node, settings)
    return settings, forgotten


def read_settings(sdo: NodeSdo) -> NodeSettings:
    """Read what the frames of a node mean; None for objects that it lacks.

    Raises:
        NodeError: it does not answer.
    """
    return {(index, sub): sdo.find_number(index, sub) for index, sub in SETTINGS}


def settings_text(settings: NodeSettings, others: NodeSettings) -> str:
    """List the settings that differ from others, in hexadecimal."""
    return ", ".join(
        f"{index:04X}:{sub:02X} was {_hexadecimal(others[index, sub])}, "
        f"is {_hexadecimal(value)}"
        for (index, sub), value in settings.items()
        if value != others[index, sub]
    )


def _hexadecimal(value: int | None) -> str:
    return "unknown" if value is None else f"{value:X}"


def _resolution(sdo: NodeSdo, kind: int, parameters: int) -> tuple[int, int]:
    """Return counts per turn and in all, as the node sends them."""
    if parameters & objects.SCALING:
        per_turn = sdo.read_number(objects.UNITS_PER_TURN)
        modulus = sdo.find_number(objects.MEASURING_RANGE) or per_turn
    else:
        per_turn = sdo.read_number(objects.TURN_RESOLUTION)
        turns = 1 if kind == SINGLE_TURN else sdo.find_number(objects.TURNS)
        modulus = per_turn * (turns or MOST_TURNS)
    if not per_turn:
        raise DeviceRefusedError(
            f"{sdo.name} reports 0 counts per turn",
            "set its resolution with the maker's tool, or replace it",
        )
    return per_turn, min(modulus, WIDEST)


def _map_position(sdo: NodeSdo, node: int) -> None:
    cob_id = wire.TPDO1 + node
    sdo.write(objects.TPDO, 1, cob_id | objects.PDO_OFF, 4)
    sdo.write(objects.TPDO, 2, objects.EVERY_SYNC, 1)
    try:
        sdo.write(objects.TPDO_MAP, 0, 0, 1)
        sdo.write(objects.TPDO_MAP, 1, objects.MAP_OF_POSITION, 4)
        sdo.write(objects.TPDO_MAP, 0, 1, 1)
    except NodeRefusedError:
        # Some makers have a fixed map; usable if the position is first in it.
        if sdo.read_number(objects.TPDO_MAP, 1) != objects.MAP_OF_POSITION:
            raise
    sdo.write(objects.TPDO, 1, cob_id, 4)


def _check_position(name: str, node: int, settings: NodeSettings) -> None:
    """Check what was written: some makers accept a write and change nothing.

    Raises:
        DeviceRefusedError: its position frame is another, or not sent at each SYNC.
    """
    cob_id = settings[objects.TPDO, 1]
    if cob_id is not None:
        cob_id &= ~objects.NO_REMOTE_REQUEST
    wrong = [
        f"{what} is {value:X}, expected {expected:X}"
        for what, value, expected in (
            ("frame and state of its TPDO1 (1800:01)", cob_id, wire.TPDO1 + node),
            (
                "its transmission type (1800:02)",
                settings[objects.TPDO, 2],
                objects.EVERY_SYNC,
            ),
            (
                "what it maps (1A00:01)",
                settings[objects.TPDO_MAP, 1],
                objects.MAP_OF_POSITION,
            ),
        )
        if value not in (None, expected)
    ]
    if wrong:
        raise DeviceRefusedError(
            f"{name} has accepted its settings and does not have them: "
            + "; ".join(wrong),
            "set TPDO1 with the maker's tool: object 6004 at every SYNC",
        )
