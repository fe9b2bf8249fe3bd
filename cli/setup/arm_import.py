"""An arm file made of an uploaded table or description."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import typer

from traverse.cli.arm.making import MadeArm, arm_from_dh_file, arm_from_urdf_file
from traverse.cli.arm.options import ArmOptions
from traverse.kinematics.arm_file.arm import write_arm
from traverse.kinematics.importers.dh_file import Units
from traverse.kinematics.importers.urdf_chain import Holds
from traverse.strict_toml.problems import FileError

ABSOLUTE, INCREMENTAL = "absolute", "incremental"
TABLES, DESCRIPTIONS = (".csv", ".toml"), (".urdf", ".xml")
FIELDS = {
    "Name of the arm": "",
    "Counts per turn (one, or one a joint)": "",
    "Tool x,y,z in mm": "",
    "Ball's radius in mm": "",
}


def import_arm(
    folder: Path,
    upload: tuple[str, bytes],
    fields: Mapping[str, str],
    *,
    convention: str | None,
    encoders: str | None,
    device: str,
) -> tuple[Path, tuple[str, ...]]:
    """Write the arm file of a Denavit-Hartenberg table or of a URDF.

    Args:
        folder: Of the new file.
        upload: Name and content.
        fields: Texts for `FIELDS`.
        convention: Of a table: "classic" or "modified".
        encoders: `ABSOLUTE`, `INCREMENTAL`, or not known.
        device: Of the encoders.

    Returns:
        The file, and remarks: changes, and implausible values.

    Raises:
        ValueError: The upload or a field is invalid, with the reason.
        OSError: The folder cannot be written.
    """
    name, counts, tool, radius = (fields[field].strip() or None for field in FIELDS)
    try:
        radius_mm = float(radius or "0")
    except ValueError:
        raise ValueError(f"a radius of {radius!r}; write a number of mm") from None
    options = ArmOptions(
        name=name,
        counts_per_turn=counts,
        absolute={ABSOLUTE: True, INCREMENTAL: False}.get(encoders or ""),
        device=device,
        tool_xyz_mm=tool,
        radius_mm=radius_mm,
    )
    file_name, content = upload
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary, Path(file_name).name)
        path.write_bytes(content)
        try:
            imported = _made(path, options, convention)
        except typer.BadParameter as error:
            raise ValueError(f"{error.param_hint}: {error.message}") from error
        except FileError as error:
            raise ValueError(str(error).replace(f"{temporary}/", "")) from error
    target = folder / f"{imported.arm.name}.toml"
    if target.exists():
        raise ValueError(f"{target} exists; give the arm another name")
    write_arm(target, imported.arm)
    return target, imported.remarks


def _made(path: Path, options: ArmOptions, convention: str | None) -> MadeArm:
    kind = path.suffix.lower()
    if kind in DESCRIPTIONS:
        return arm_from_urdf_file(path, None, None, Holds(), options)
    if kind not in TABLES:
        raise ValueError(
            f"{path.name}: expected a Denavit-Hartenberg table ({', '.join(TABLES)}) "
            f"or a robot description ({', '.join(DESCRIPTIONS)})"
        )
    return arm_from_dh_file(
        path,
        Units(None, None),
        options,
        convention=convention,
        base_xyz_mm=None,
        base_rpy_rad=None,
    )
