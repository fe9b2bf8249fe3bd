"""Tools of I++ DME: the probe library, and the parameters that clients set."""

from collections.abc import Mapping, Sequence

from traverse.client.gateways.ippdme.grammar import IppError

OWN = "RefTool"
"""Name of the arm file's probe."""
NONE = "NoTool"
"""Name of the tool that does not measure."""
UNDEFINED = "UnDefTool"
PARAMETERS = {
    "GoToPar.Speed": (0.0, 1000.0, 100.0),
    "GoToPar.Accel": (0.0, 10_000.0, 1000.0),
    "PtMeasPar.Speed": (0.0, 1000.0, 10.0),
    "PtMeasPar.Accel": (0.0, 10_000.0, 1000.0),
    "PtMeasPar.Approach": (0.0, 1000.0, 2.0),
    "PtMeasPar.Search": (0.0, 1000.0, 2.0),
    "PtMeasPar.Retract": (-1000.0, 1000.0, 0.0),
}
"""Least, greatest and default value [mm, s]. They are kept for clients that expect
them; an arm is led by hand, so none has an effect."""
SUBS = ("Min", "Max", "Act", "Def")
_TYPES = {
    "Name": "String",
    "AvrRadius": "Number",
    "Alignment": "Number",
    **dict.fromkeys(PARAMETERS, "Number"),
    **{f"{key}.{sub}": "Number" for key in PARAMETERS for sub in SUBS},
}


class Tools:
    """Known tools, and the active one.

    Attributes:
        active: name of the active tool.
        radii_mm: radii of balls by tool, as far as known.
        library: names of the probes of the library.
    """

    def __init__(self, radii_mm: Mapping[str, float]) -> None:
        self.active = OWN
        self.found_tool = UNDEFINED
        self.radii_mm = {**radii_mm, NONE: 0.0}
        self.library: Sequence[str] = ()
        self._actual: dict[str, float] = {}

    @property
    def names(self) -> tuple[str, ...]:
        return (OWN, NONE, *self.library)

    def activate(self, name: str) -> None:
        if name != self.active:
            self.active = name
            self._actual.clear()

    def require(self, name: object) -> str:
        """Return the name of an existing tool; raises IppError."""
        if not isinstance(name, str):
            raise IppError(509, "the name of a tool is in quotes")
        if name not in self.names:
            raise IppError(1502, f"{name}; there are: {', '.join(self.names)}")
        return name

    def split(self, path: str) -> tuple[str, str]:
        """Return tool and property of `Tool.Name`, `FoundTool.Name` or `GoToPar.x`."""
        first, _, property_name = path.partition(".")
        if first == "FoundTool":
            # Asked for its name, it says that there is none.
            if self.found_tool == UNDEFINED and property_name != "Name":
                raise IppError(1503, "FindTool has found none")
            return self.found_tool, property_name
        return self.active, property_name if first == "Tool" else path

    def parameter(self, tool: str, path: str) -> float:
        """Return a number among the properties; raises IppError."""
        if path == "AvrRadius":
            if tool not in self.radii_mm:
                raise IppError(1503, f"the radius of {tool} is not known here")
            return self.radii_mm[tool]
        name, _, sub = path.rpartition(".")
        if path in PARAMETERS:
            name, sub = path, "Act"
        if name not in PARAMETERS or sub not in SUBS:
            raise IppError(510, f"{path} is no property of a tool")
        least, greatest, default = PARAMETERS[name]
        actual = self._actual.get(name, default) if tool == self.active else default
        return {"Min": least, "Max": greatest, "Act": actual, "Def": default}[sub]

    def set_parameter(self, tool: str, path: str, value: float) -> bool:
        """Set a parameter; return whether it is within its range. Raises IppError."""
        name = path.removesuffix(".Act")
        if name not in PARAMETERS or tool != self.active:
            raise IppError(510, f"{path} of {tool} cannot be set")
        least, greatest, _ = PARAMETERS[name]
        self._actual[name] = min(max(value, least), greatest)
        return self._actual[name] == value


def children(path: str, *, deep: bool) -> list[tuple[str, str]]:
    """Return names and types of an object's properties; raises IppError."""
    prefix = f"{path}." if path else ""
    below = {
        k.removeprefix(prefix): v for k, v in _TYPES.items() if k.startswith(prefix)
    }
    if not below:
        raise IppError(510, f"{path} is no object")
    direct = [(name, kind) for name, kind in below.items() if "." not in name]
    if deep:
        return direct + [(name, kind) for name, kind in below.items() if "." in name]
    parents = dict.fromkeys(name.split(".")[0] for name in below if "." in name)
    return direct + [(name, "Property") for name in parents]
