"""Read the daemon's input files; report all mistakes."""

import errno
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from traverse.broker.address import BrokerAddress
from traverse.broker.credentials import CredentialsError, read_credentials
from traverse.daemon.config.schema import (
    BrokerSection,
    Configuration,
    read_configuration,
)
from traverse.daemon.pose.arm_model import ArmModel, model_with_probe, read_model
from traverse.daemon.pose.probe_library import (
    LibraryProbe,
    ProbeLibrary,
    read_probe_in_use,
    read_probes,
)
from traverse.daemon.state_dir import PROBE, state_path, unusable
from traverse.daemon.store.point_signer import PointSigner, read_signer
from traverse.strict_toml.problems import FileError, Problem, reason_of, system_reason

REFUSED = 2
UNREACHABLE = 3
# Of a disk or a share that is mounted later, or does not answer for a while.
ABSENCES = frozenset(
    {
        *(errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO),
        *(errno.ENOTCONN, errno.ESTALE, errno.ETIMEDOUT, errno.EHOSTDOWN),
    }
)
NO_FILE_OF_OURS = (errno.EINVAL, errno.EISDIR, errno.EFBIG)  # a FIFO, say


class StartupError(Exception):
    """The daemon cannot start.

    Attributes:
        status: exit status: 2 for refused input, 3 for an unreachable device, broker
            or file.
        files: failures that are mistakes in files.
    """

    def __init__(self, failures: Sequence[str | FileError], status: int) -> None:
        self.files = [f for f in failures if isinstance(f, FileError)]
        lines = ["traverse cannot start:"]
        for failure in failures:
            first, *further = str(failure).splitlines()
            lines += [f"  - {first}", *(f"    {line}" for line in further)]
        super().__init__("\n".join(lines))
        self.status = status


class Inputs(NamedTuple):
    """Inputs of the daemon.

    Attributes:
        probes: names in the probe library; None without one.
        signer: of points; None if they are not signed.
        probe: of the library, as chosen last; None: that of the arm file.
    """

    configuration: Configuration
    model: ArmModel
    probes: tuple[str, ...] | None = None
    signer: PointSigner | None = None
    probe: LibraryProbe | None = None


def address_of(section: BrokerSection, folder: Path) -> BrokerAddress:
    values = section.model_dump(exclude={"response_topics", "encoding"})
    return BrokerAddress(**values, folder=folder)


def read_inputs(path: Path, embedded: bool) -> Inputs:
    """Read the configuration and the files that it names.

    Raises:
        StartupError: lists all mistakes.
    """
    try:
        configuration = read_configuration(path)
    except FileError as error:
        raise StartupError([error], REFUSED) from error
    failures: list[FileError] = []
    if not embedded:
        failures += _broker_failures(path, configuration.broker)
    ids = {device.id: device for device in configuration.device}
    try:
        model = read_model(path.parent / configuration.arm.file, ids)
    except FileError as error:
        raise _startup_error([*failures, error]) from error
    library = None
    if configuration.arm.probes is not None:
        try:
            library = read_probes(path.parent / configuration.arm.probes)
        except FileError as error:
            failures.append(error)
    problems = _cross_check(configuration, model)
    signer = None
    if configuration.signing.key is not None:
        key = path.parent / configuration.signing.key
        try:
            signer = read_signer(key)
        except (ValueError, OSError) as error:
            problems.append(Problem("signing.key", f"{key} {reason_of(error)}"))
    if problems:
        failures.append(FileError(path, problems))
    probe = None
    try:
        if configuration.arm.probes is None or library is not None:
            probe = _probe_in_use(state_path(path) / PROBE, library, model)
    except FileError as error:
        failures.append(error)
    except OSError as error:
        folder = FileError(state_path(path), unusable(error))
        raise StartupError(
            [*failures, folder], _startup_error(failures).status
        ) from error
    if failures:
        raise _startup_error(failures)
    probes = None if library is None else library.names
    return Inputs(configuration, model, probes, signer, probe)


def _broker_failures(path: Path, section: BrokerSection | None) -> Iterator[FileError]:
    if section is None:
        text = "is missing; add a table [broker], or use --embedded-broker"
        yield FileError(path, [Problem("broker", text)])
        return
    try:
        read_credentials(address_of(section, path.parent))
    except CredentialsError as error:
        failure = FileError(path, [Problem(f"broker.{error.key}", error.text)])
        failure.__cause__ = error
        yield failure


def _startup_error(failures: Sequence[FileError]) -> StartupError:
    """Return the error of files; one that is only absent may come later."""
    status = UNREACHABLE if all(map(_is_absence, failures)) else REFUSED
    return StartupError(failures, status)


def _is_absence(error: BaseException | None) -> bool:
    """Return whether a file was not there, or the disk or share that it is on."""
    while error is not None and not isinstance(error, OSError):
        error = error.__cause__
    return error is not None and error.errno in ABSENCES


def _probe_in_use(
    path: Path, library: ProbeLibrary | None, model: ArmModel
) -> LibraryProbe | None:
    """Find the probe that was chosen before the daemon ended: it may still be on.

    Raises:
        FileError: it is not known, or the arm cannot have it any more.
        OSError: the state folder cannot be used.
    """
    remedy = "; choose again after deleting this file: then the arm file's is in use"
    try:
        name = read_probe_in_use(path)
        if name is None:
            return None
        probe = None if library is None else library.named(name)
        if probe is None:
            raise ValueError(f"no probe library of the configuration has {name!r}")
        model_with_probe(model, probe)
    except OSError as error:
        if error.errno not in NO_FILE_OF_OURS:
            raise
        raise FileError(path, [Problem("name", system_reason(error))]) from error
    except ValueError as error:
        text = f"the probe in use is not known: {error}{remedy}"
        raise FileError(path, [Problem("name", text)]) from error
    return probe


def _cross_check(configuration: Configuration, model: ArmModel) -> list[Problem]:
    """Find end stops of unknown joints, duplicates, and a clock that reads no joint."""
    problems, seen = [], set()
    for index, stop in enumerate(configuration.quality.end_stops):
        where = f"quality.end_stops[{index}].joint"
        names = model.effects.joint_names
        if stop.joint not in names:
            text = f"{stop.joint!r} is no joint of the arm; it has: {', '.join(names)}"
            problems.append(Problem(where, text))
        elif stop.joint in seen:
            problems.append(Problem(where, f"{stop.joint!r} is given twice"))
        seen.add(stop.joint)
    clock = configuration.assembly.clock
    if clock is not None and clock not in model.devices:
        text = f"{clock!r} reads no joint; one of these does: " + ", ".join(
            model.devices
        )
        problems.append(Problem("assembly.clock", text))
    return problems
