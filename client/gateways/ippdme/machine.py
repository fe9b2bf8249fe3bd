"""The arm in terms of I++ DME: poses, coordinate systems, tools, properties."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.client.gateways.ippdme import tools
from traverse.client.gateways.ippdme.grammar import (
    Argument,
    IppError,
    Property,
    Word,
    number,
    property_text,
    quoted,
)
from traverse.protocol.messages import Live, Point

STALE_S = 2.0  # live poses arrive many times a second while the arm is there
Args = Sequence[Argument]
OF_POINT = ("IJK", "Q", "ER")
AXES = ("X", "Y", "Z")
N_NUMBERS = {"X": 1, "Y": 1, "Z": 1, "IJK": 3}  # of a target


class Machine:
    """State that outlives sessions.

    Args:
        radii_mm: radii of balls by tool, as far as known.
        clock: monotonic time [s].

    Attributes:
        is_reachable: the arm and the broker are there.
        alarm: why the arm cannot be trusted, or None.
    """

    def __init__(
        self, radii_mm: Mapping[str, float], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.systems = Systems()
        self.tools = tools.Tools(radii_mm)
        self.live: Live | None = None
        self.live_s = -np.inf
        self.is_reachable = True
        self.alarm: str | None = None
        self._clock = clock

    def take_live(self, live: Live) -> None:
        self.live, self.live_s = live, self._clock()

    def pose(self) -> Live:
        """Return the present pose; raises IppError."""
        if (
            self.live is None
            or not self.is_reachable
            or self._clock() - self.live_s > STALE_S
        ):
            raise IppError(503, "the arm sends no poses")
        return self.live

    def require_good(self, measured: Point | Live, subject: str) -> None:
        """Refuse measurements in doubt; raises IppError."""
        is_point = isinstance(measured, Point)
        if not measured.quality.ok:
            flags = ", ".join(measured.quality.flags)
            raise IppError(
                1001 if is_point else 1000, f"{subject} is in doubt ({flags})"
            )
        if self.alarm:
            raise IppError(1000, f"{subject}: {self.alarm}")
        if is_point:
            self.require_probe()

    def require_probe(self) -> None:
        """Check that the active tool measures; raises IppError."""
        if self.tools.active == tools.NONE:
            raise IppError(2002, f"{tools.NONE} does not measure")

    def values(self, names: Sequence[str], measured: Point | Live | None) -> str:
        return ",".join(self._value(name, measured) for name in names)

    def _value(self, name: str, measured: Point | Live | None) -> str:
        if name in AXES and measured is not None:
            place = self.systems.point(measured.xyz_mm)
            return property_text(name, place[AXES.index(name)])
        if name in OF_POINT and isinstance(measured, Point):
            if name == "IJK":
                outwards = _out_of_material(measured)
                return property_text(name, *self.systems.direction(outwards))
            return property_text(name, measured.probe_radius_mm * (name == "ER"))
        tool, path = self.tools.split(name)
        if path == "Name":
            return property_text(name, tool)
        if path == "Alignment" and tool == self.tools.active:
            if measured is None:
                measured = self.pose()
                self.require_good(measured, "the pose")
            i, j, k = measured.ijk
            return property_text(name, *self.systems.direction((-i, -j, -k)))
        return property_text(name, self.tools.parameter(tool, path))

    def enumerated(
        self, args: Args, *, of_point: bool = False, axes: bool = True
    ) -> tuple[str, ...]:
        """Return the names of an enumeration, each once, all known; raises IppError."""
        names: list[str] = []
        for arg in args:
            if not isinstance(arg, Property) or arg.values or arg.name in names:
                raise IppError(509, f"{shown(arg)}: expected Name() once")
            names.append(arg.name)
            if arg.name in OF_POINT:
                if not of_point:
                    raise IppError(508, f"{arg.name} is of a point")
            elif arg.name not in AXES or not axes:
                tool, path = self.tools.split(arg.name)
                if path not in ("Name", "AvrRadius", "Alignment"):
                    self.tools.parameter(tool, path)
        if not names:
            raise IppError(502, "the enumeration is empty")
        return tuple(names)

    # Commands: their arguments in, lines of data out; raise IppError

    def _get(self, args: Args) -> Sequence[str]:
        names = self.enumerated(args)
        pose = self.pose()
        self.require_good(pose, "the pose")
        return (self.values(names, pose),)

    def _get_prop(self, args: Args) -> Sequence[str]:
        return (self.values(self.enumerated(args, axes=False), None),)

    def _set_prop(self, args: Args) -> None:
        outside = []
        for arg in args:
            if not isinstance(arg, Property) or len(arg.values) != 1:
                raise IppError(509, f"{shown(arg)}: expected Name(value)")
            if not self.tools.set_parameter(*self.tools.split(arg.name), arg.values[0]):
                outside.append(arg.name)
        if not args:
            raise IppError(502, "the enumeration is empty")
        if outside:
            raise IppError(
                504, f"{', '.join(outside)}: set to the nearest allowed value"
            )

    def _enum_prop(self, args: Args, *, deep: bool = False) -> Sequence[str]:
        (arg,) = args
        if not isinstance(arg, Property) or arg.values:
            raise IppError(509, f"{shown(arg)}: expected an object such as Tool()")
        _, path = self.tools.split(arg.name)
        objects = tools.children(path, deep=deep)
        return [f"{quoted(name)},{quoted(kind)}" for name, kind in objects]

    def _enum_tools(self, _: Args) -> Sequence[str]:
        return [quoted(name) for name in self.tools.names]

    def _find_tool(self, args: Args) -> None:
        self.tools.found_tool = tools.UNDEFINED
        self.tools.found_tool = self.tools.require(args[0])

    def _get_system(self, _: Args) -> Sequence[str]:
        return (f"CoordSystem({self.systems.selected})",)

    def _get_transformation(self, args: Args) -> Sequence[str]:
        values = self.systems.values(word(args[0]))
        return (property_text("GetCsyTransformation", *values),)

    def _set_transformation(self, args: Args) -> None:
        name, *numbers = args
        values = tuple(value for value in numbers if isinstance(value, float))
        if len(values) != 6:
            raise IppError(509, "expected a system and six numbers")
        self.systems.set(word(name), values)

    COMMANDS: ClassVar[
        Mapping[
            str, tuple[Callable[["Machine", Args], Sequence[str] | None], int | None]
        ]
    ] = {
        "Get": (_get, None),
        "GetProp": (_get_prop, None),
        "GetPropE": (_get_prop, None),
        "SetProp": (_set_prop, None),
        "EnumProp": (_enum_prop, 1),
        "EnumAllProp": (partial(_enum_prop, deep=True), 1),
        "EnumTools": (_enum_tools, 0),
        "FindTool": (_find_tool, 1),
        "GetCoordSystem": (_get_system, 0),
        "GetCsyTransformation": (_get_transformation, 1),
        "SetCsyTransformation": (_set_transformation, 7),
    }
    """Method, and number of arguments; None: several."""


def shown(arg: Argument) -> str:
    match arg:
        case Property():
            return property_text(arg.name, *arg.values)
        case Word():
            return arg.name
        case str():
            return quoted(arg)
    return number(arg)


def word(arg: Argument) -> str:
    """Return a name without quotes; raises IppError."""
    if not isinstance(arg, Word):
        raise IppError(509, f"{shown(arg)}: expected a name without quotes")
    return arg.name


def _out_of_material(point: Point) -> tuple[float, float, float]:
    """Return the direction from the material to the ball; zeros if unknown."""
    if point.surface_mm is None:
        return (0.0, 0.0, 0.0)
    outwards = np.subtract(point.xyz_mm, point.surface_mm)
    length = float(np.linalg.norm(outwards))
    i, j, k = outwards / length if length else np.zeros(3)
    return (float(i), float(j), float(k))


CHAIN = ("MachineCsy", "MoveableMachineCsy", "MultipleArmCsy", "PartCsy")
"""Systems that can be selected, from the machine to the part."""
STORED = ("JogDisplayCsy", "JogMoveCsy", "SensorCsy", *CHAIN[1:])
"""Transformations that can be set; the first three have no effect on points."""


class Systems:
    """Transformations, and the selected system."""

    def __init__(self) -> None:
        self.selected = CHAIN[0]
        self._values = dict.fromkeys(STORED, (0.0,) * 6)

    def select(self, name: str) -> None:
        """Select a system; raises IppError."""
        if name not in CHAIN:
            raise IppError(509, f"{name}: expected one of {', '.join(CHAIN)}")
        self.selected = name

    def values(self, name: str) -> tuple[float, ...]:
        """Return X0, Y0, Z0 [mm], theta, psi, phi [degrees]; raises IppError."""
        if name not in STORED:
            raise IppError(509, f"{name}: expected one of {', '.join(STORED)}")
        return self._values[name]

    def set(self, name: str, values: tuple[float, ...]) -> None:
        """Set a transformation by the same six values; raises IppError."""
        self.values(name)
        x, y, z, theta, psi, phi = values
        if not 0.0 <= theta <= 180.0:
            raise IppError(1007, f"theta {theta:g}; expected 0 to 180 degrees")
        self._values[name] = (x, y, z, theta, psi % 360.0, phi % 360.0)

    def point(self, xyz_mm: tuple[float, ...]) -> Floats:
        """Transform the ball centre [mm] (3,) from the arm's to the selected system.

        X0, Y0 and Z0 are the zero of the system before in this one (6.3.3.4).
        """
        place = np.array(xyz_mm)
        for name in self._steps():
            place = _rotation(*self._values[name][3:]) @ place + self._values[name][:3]
        return place

    def direction(self, ijk: tuple[float, ...]) -> Floats:
        """Transform a direction (3,) from the arm's to the selected system."""
        turned = np.array(ijk)
        for name in self._steps():
            turned = _rotation(*self._values[name][3:]) @ turned
        return turned

    def _steps(self) -> tuple[str, ...]:
        return CHAIN[1 : CHAIN.index(self.selected) + 1]


def _rotation(theta: float, psi: float, phi: float) -> Floats:
    """Matrix of appendix A.4.2: about z by psi, x by theta, z by phi [degrees]."""
    angles = np.radians([theta, psi, phi])
    (c1, c2, c3), (s1, s2, s3) = np.cos(angles), np.sin(angles)
    about_z = np.array([[c2, s2, 0], [-s2, c2, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, c1, s1], [0, -s1, c1]])
    about_new_z = np.array([[c3, s3, 0], [-s3, c3, 0], [0, 0, 1]])
    turn: Floats = about_new_z @ about_x @ about_z
    return turn


def target_values(args: Args) -> dict[str, tuple[float, ...]]:
    """Read the arguments of `PtMeas`: coordinates of a target, and a direction.

    Raises:
        IppError: one of them is wrong, or no coordinate is given.
    """
    values_of: dict[str, tuple[float, ...]] = {}
    for arg in args:
        if (
            not isinstance(arg, Property)
            or arg.name in values_of
            or len(arg.values) != N_NUMBERS.get(arg.name)
        ):
            raise IppError(509, f"{shown(arg)}: expected X(x), Y(y), Z(z), IJK(i,j,k)")
        values_of[arg.name] = arg.values
    if values_of.keys() <= {"IJK"}:
        raise IppError(509, "X, Y or Z is missing")
    if not any(values_of.get("IJK", (1.0,))):
        raise IppError(1010, "IJK(0,0,0)")
    return values_of
