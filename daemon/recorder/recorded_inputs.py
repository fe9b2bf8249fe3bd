"""Arm and configuration in a recording."""

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from traverse.daemon.config.schema import Configuration, read_configuration
from traverse.daemon.pose.arm_model import ArmModel, model_with_probe, read_model
from traverse.daemon.pose.probe_library import LibraryProbe
from traverse.kinematics.arm_file.arm import read_arm
from traverse.strict_toml.files import bytes_of

ARM, CONFIGURATION, PROBES = "arm.toml", "traverse.toml", "probes.toml"


def recorded_files(path: Path, configuration: Configuration) -> dict[str, bytes]:
    """Collect the files that a replay needs, by name.

    Raises:
        OSError: a file cannot be read.
    """
    arm_path = path.parent / configuration.arm.file
    files = {CONFIGURATION: bytes_of(path), ARM: bytes_of(arm_path)}
    identification = read_arm(arm_path).identification
    if identification is not None and identification.covariance_file is not None:
        covariance = arm_path.parent / identification.covariance_file
        files[identification.covariance_file] = bytes_of(covariance)
    if configuration.arm.probes is not None:
        files[PROBES] = bytes_of(path.parent / configuration.arm.probes)
    return files


def read_recorded_inputs(
    files: Mapping[str, bytes], probe: str | None
) -> tuple[Configuration, ArmModel]:
    """Read configuration and arm of a recording, with the probe in use.

    Raises:
        ValueError: they are missing or wrong, also as kinematics' `FileError`.
        OSError: a temporary folder cannot be written.
    """
    missing = [name for name in (ARM, CONFIGURATION) if name not in files]
    if missing:
        raise ValueError(f"the recording lacks {', '.join(missing)}")
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in files.items():
            path = (folder / file).resolve()
            if not path.is_relative_to(folder.resolve()):
                raise ValueError(
                    f"the recording has a file {file!r}, outside of its own folder; "
                    "name the arm's covariance file beside the arm file"
                )
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        configuration = read_configuration(folder / CONFIGURATION)
        ids = {device.id: device for device in configuration.device}
        model = read_model(folder / ARM, ids)
    if probe is not None:
        chosen = LibraryProbe.model_validate_json(probe)
        model = model_with_probe(model, chosen)
    return configuration, model
